"""While a robot runs, its status says which task has failed."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    controller,
    emulator,
    endpoint,
    inside,
    wait_for_mode,
)

WAVE = """
controller: clik_sdp
robot: ur5
parameters:
  tasks:
    - task: posture
      parameters:
        target: {kind: trajectory, file: wave.csv, path_tolerance: TOLERANCE}
"""
POINTS = """t,elbow_joint
0.0,1.6
0.5,1.7
1.0,1.6
"""


@pytest.mark.slow
@pytest.mark.parametrize(("tolerance", "fails"), [("1.0e-9", True), ("1.0", False)])
def test_the_status_says_that_a_trajectory_left_its_tolerance(tmp_path: Path, tolerance, fails):
    (tmp_path / "wave.csv").write_text(POINTS.lstrip())
    (tmp_path / "wave.yaml").write_text(WAVE.replace("TOLERANCE", tolerance))
    at = endpoint()
    with (
        emulator("ur5", *QUIET, *PATIENT, at=at),
        controller(tmp_path / "wave.yaml", *QUIET, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, "ur5")
        for _ in range(60):
            found = inside("status", "ur5", "--connect", at, "--json").json()
            (task,) = found["tasks"]
            if task["reason"]:
                break
        assert bool(task["reason"]) is fails
        assert not fails or "elbow_joint" in task["reason"]
        told = inside("status", "ur5", "--connect", at).stdout
        assert ("elbow_joint" in told) is fails
        assert inside("stop", "ur5", "--connect", at).code == 0
        wait_for_mode("stopped", at, "ur5")
        assert inside("status", "ur5", "--connect", at, "--json").json()["tasks"] is None
