"""Somebody's own constraint is tried once before a robot depends on it, and refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from support.constraint_bench import PERIOD, hoap3

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.constraints import registry
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.registry import ConstraintSettings, build
from hoap3.remote_controller.model.kinematics import Kinematics

N = 21


class Own(Constraint):
    """Two rows and a margin, all in order."""

    def __init__(self, parameters, description, kinematics, period_s):
        super().__init__(parameters, description, kinematics, period_s)
        self.rows, self.names = 2, ("one", "two")
        self.margins, self.margin_names = np.ones(1), ("height",)

    def update(self, kinematics, state, A_out, b_out):
        A_out[:], b_out[:] = 1.0, np.inf
        self.watch()


class NanRow(Own):
    def update(self, kinematics, state, A_out, b_out):
        super().update(kinematics, state, A_out, b_out)
        A_out[1, 3] = np.nan


class NanSide(Own):
    def update(self, kinematics, state, A_out, b_out):
        b_out[0] = np.nan


class EndlessEquation(Own):
    equality = True


class NanMargin(Own):
    def update(self, kinematics, state, A_out, b_out):
        self.margins[0] = np.nan


class WideRow(Own):
    def update(self, kinematics, state, A_out, b_out):
        A_out[0] = np.ones(N + 1)


class FewNames(Own):
    def __init__(self, parameters, description, kinematics, period_s):
        super().__init__(parameters, description, kinematics, period_s)
        self.names = ("one",)


class ManyMargins(Own):
    def update(self, kinematics, state, A_out, b_out):
        self.margins = np.ones((2, 2))


class NanBound(Own):
    def bounds(self, state, lower_out, upper_out):
        upper_out[5] = np.nan


class EmptyBound(Own):
    def bounds(self, state, lower_out, upper_out):
        lower_out[:], upper_out[:] = 1.0, -1.0


WRONG = {
    NanRow: r"A_out\[1, 3\].*two, r_knee.*nan",
    NanSide: r"b_out\[0\].*one.*nan",
    EndlessEquation: r"b_out\[0\].*one.*inf",
    NanMargin: "height.*nan",
    WideRow: r"ValueError: .*test_first_update.py, line \d+",
    FewNames: "rows.*2.*names.*1",
    ManyMargins: r"margins.*\(2, 2\).*margin_names.*1",
    NanBound: "-inf.*nan",
    EmptyBound: "1.0.*-1.0",
}


def made(own: type[Constraint]):
    settings = ConstraintSettings(constraint=f"{__name__}:{own.__name__}")
    return build([settings], hoap3(), Kinematics(hoap3()), PERIOD, "mine.yaml")


@pytest.mark.parametrize("own", WRONG)
def test_what_is_no_constraint_is_refused(own: type[Constraint]) -> None:
    with pytest.raises(ConfigError, match=WRONG[own]) as error:
        made(own)
    assert error.value.file == "mine.yaml"
    assert error.value.key == "parameters.constraints.0.constraint"
    assert error.value.value == f"{__name__}:{own.__name__}"
    assert error.value.remedy


def test_what_is_one_is_used_untouched() -> None:
    (own,) = made(Own).constraints
    assert own.events == {"outside": 0, "started_outside": 0}
    assert not own._started


def test_ours_are_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("was tried")

    monkeypatch.setattr(registry, "check_first_update", never)
    entries = [ConstraintSettings(constraint="joint_velocity")]
    assert len(build(entries, hoap3(), Kinematics(hoap3()), PERIOD).constraints) == 1
