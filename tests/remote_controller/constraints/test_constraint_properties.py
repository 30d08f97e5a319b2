"""Every registered constraint has what every constraint must have."""

from __future__ import annotations

from registered_constraints import cases

from hoap3.remote_controller.constraints.registry import find, registered
from hoap3.testing import ConstraintProperties


class TestRegistered(ConstraintProperties):
    cases = cases()

    def test_every_registered_constraint_is_tried(self):
        tried = {case.settings.constraint for case in self.cases}
        assert tried == {name for name in registered() if find(name).serves("velocity")}
