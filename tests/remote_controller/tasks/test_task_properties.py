"""Every registered task has what every task must have."""

from __future__ import annotations

from registered_tasks import cases, velocity_tasks

from hoap3.testing import TaskProperties


class TestRegistered(TaskProperties):
    cases = cases()

    def test_every_registered_task_is_tried(self):
        assert {case.settings.task for case in self.cases} == set(velocity_tasks())
