"""A pose of a running robot, steered from Python with the config of its page; its log is true."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import HOUSE
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    controller,
    emulator,
    endpoint,
    wait_for_mode,
)

import hoap3
from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.replay import replay
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

ROBOT = "ur5"
PAGE = HOUSE / "docs" / "steering.md"
DOWN = Rotation.from_quat([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
AIM = Rotation.from_rotvec([0.0, 0.4, 0.0]) * DOWN
PLACE = np.array([-0.5, -0.15, 0.35])


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def steered(at: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Command, Path]]:
    """UR5 that follows the page's config; the controller, and the folder of its log."""
    folder = tmp_path_factory.mktemp("posed")
    config, log = folder / "pose.yaml", folder / "log"
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(r"<!-- file: pose.yaml -->\n```yaml\n(.*?)```", text, re.DOTALL)
    assert found is not None
    config.write_text(found[1].replace("5.0", "60.0"), encoding="utf-8")
    with (
        emulator(ROBOT, *QUIET, *PATIENT, at=at),
        controller(config, "--out", log, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, ROBOT)
        yield law, log


def off(q: np.ndarray) -> tuple[float, float]:
    """How far the tool is from where it shall be [m], and turned [rad]."""
    robot = hoap3.load_robot(ROBOT)
    kinematics = Kinematics(robot)
    kinematics.update(q)
    frames = kinematics.frame_id("tool0"), kinematics.frame_id(robot.base_frame)
    place, turn = np.zeros(3), np.zeros((3, 3))
    kinematics.frame(*frames, place, turn, np.zeros((6, robot.n)))
    away = Rotation.from_matrix(turn) * AIM.inv()
    return float(np.linalg.norm(place - PLACE)), float(away.magnitude())


def test_a_pose_is_reached(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        (target,) = robot.acquire(timeout_s=60.0)
        assert target["layout"] == ["x", "y", "z", "qx", "qy", "qz", "qw"]
        assert (target["dimension"], target["rates"]) == (7, 6)
        for _ in range(5):  # a busy machine takes the lease from whoever renews it too late
            robot.send_target([*PLACE, *AIM.as_quat()])
            if any(max(off(state.q)) < 1e-3 for state in islice(robot.states(), 1_000)):
                break
            robot.acquire(timeout_s=60.0)
        else:
            pytest.fail(f"it never came there: {robot.status()}, {robot.counts()}")
        assert robot.counts()["taken"] >= 1


def test_a_chunk_of_poses_has_rates_of_six_numbers(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        robot.acquire(timeout_s=60.0)
        points, rates = np.tile([*PLACE, *AIM.as_quat()], (5, 1)), np.zeros((5, 6))
        robot.send_chunk(points, robot.state().tick, 50, rates)
        with pytest.raises(BadProblemError, match=r"\(5, 6\)"):
            robot.send_chunk(points, robot.state().tick, 50, np.zeros((5, 7)))
        with pytest.raises(BadProblemError, match=r"\(p, 7\)"):
            robot.send_target(PLACE)
        robot.send_target([*PLACE, 0.0, 0.0, 0.0, 0.5])
        for _ in islice(robot.states(), 20):
            pass
        counts = robot.counts()
        assert (counts["taken"], counts["refused"]) == (1, {"not_unit": 1})


def test_its_log_is_repeated_and_true(steered):
    law, folder = steered
    assert law.end(2) == 0
    again = replay(folder, [])
    assert again.identical, str(again)
    found = verify(folder)
    assert found.claims.by_tick() == []
    open_ = {name for name, one in found.claims.as_json()["claims"].items() if one["unverified"]}
    assert open_ == {"both logs"}  # the robot keeps none here
