"""`hoap3 limits`."""

from __future__ import annotations

import json
import re

import pytest
from support.command_bench import inside
from typer.testing import CliRunner

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots import load
from hoap3.tools.cli.app import app


def found(*words: str, code: int) -> dict:
    result = CliRunner().invoke(app, ["limits", *words, "--samples", "20000", "--json"])
    assert result.exit_code == code
    return json.loads(result.stdout)


def test_a_robot_that_claims_no_more_than_it_has_is_fit():
    told = found("ur5", code=0)
    robot: RobotDescription = load("ur5")
    assert [row["joint"] for row in told["joints"]] == list(robot.joint_names)
    assert told["findings"] == []
    for row in told["joints"]:
        assert row["lower"] < 0.0 < row["upper"]
        assert row["either_way"] == min(-row["lower"], row["upper"]) >= row["brake_acceleration"]


def test_joints_that_cannot_hold_their_load_or_claim_too_much_are_named():
    (line,) = found("baxter_left_arm", code=1)["findings"]
    assert line.startswith("left_s1: ")
    told = found("hoap3", code=1)["findings"]
    assert any(re.match(r"r_hip_yaw: .*brake_acceleration.* 40\b", line) for line in told)


@pytest.mark.parametrize(
    ("words", "message"),
    [("nosuch", "nosuch"), ("ur5 --velocities some", "corners"), ("ur5 --samples 0", "samples")],
)
def test_wrong_words_are_one_clear_error(words, message):
    done = inside("limits", *words.split())
    assert done.code == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
