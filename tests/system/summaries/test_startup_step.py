"""A step of speed in the first 200 ticks is a note with limit and remedy; a later one fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.command_bench import inside

from hoap3.robot_emulator.robots import load
from hoap3.tools.verify.verify import verify

STEP = """
import numpy as np
from hoap3.remote_controller.controllers.base import VelocityController


class Step(VelocityController):
    class Parameters(VelocityController.Parameters):
        from_s: float = 0.0

    def reset(self, state, last_command):
        super().reset(state, last_command)
        self.first = state.tick

    def velocity(self, state):
        u = np.zeros(self.description.n)
        if (state.tick - self.first) * self.description.period_s >= self.parameters.from_s:
            u[0] = SPEED
        return u
"""
PERIODS = 3
"""Of the robot's first joint: how often its acceleration is needed to reach the speed."""


def stepped(folder: Path, from_s: float) -> tuple[dict[str, Any], str]:
    """A run of UR5 whose first joint is to move at once, `from_s` after the start; and its line."""
    limit = float(load("ur5").setpoint_acceleration_max[0])
    speed = (PERIODS - 0.5) * limit * 1e-3
    (folder / "step.py").write_text(STEP.replace("SPEED", repr(speed)), encoding="utf-8")
    law = {"controller": "step:Step", "parameters": {"from_s": from_s}}
    (folder / "step.yaml").write_text(json.dumps(law), encoding="utf-8")
    words = ("--robot", "ur5", "--controller", folder / "step.yaml", "--duration", 0.5)
    found = inside("run", "--lockstep", *words, "--out", folder / "log", "--json").json()
    return found, found["limits_and_balance"]["text"]


def test_a_start_up_step_is_a_note_that_names_limit_and_remedy(tmp_path):
    found, text = stepped(tmp_path, 0.0)
    limits, robot = found["limits_and_balance"], load("ur5")
    assert limits["held_back"] == limits["startup_interventions"] == PERIODS - 1
    assert found["verdicts"]["limits_and_balance"] == "pass"
    assert limits["reasons"] == []
    limit = {"limit": "acceleration", "value": robot.setpoint_acceleration_max[0], "unit": "rad/s²"}
    assert limits["held_back_limit"] == limit
    for word in ("acceleration", f"{limit['value']:.4g} rad/s²", "200 ticks", "ramp"):
        assert word in text
    assert verify(tmp_path / "log").claims.by_tick() == []


@pytest.mark.parametrize(("from_s", "at_start"), [(0.1, PERIODS - 1), (0.3, 0)])
def test_after_200_ticks_it_fails_and_names_them_as_well(from_s, at_start, tmp_path):
    found, text = stepped(tmp_path, from_s)
    limits = found["limits_and_balance"]
    assert (limits["held_back"], limits["startup_interventions"]) == (PERIODS - 1, at_start)
    assert found["verdicts"]["limits_and_balance"] == ("pass" if at_start else "fail")
    assert limits["reasons"] == ([] if at_start else ["held_back"])
    assert "acceleration limit" in text
    assert "ramp" in text
