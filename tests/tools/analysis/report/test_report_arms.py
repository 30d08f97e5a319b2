"""A report of an arm shows its tool and no sole; every report, positions within their limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.robots.following_arm import write

from hoap3.protocol.robot.description import COM
from hoap3.tools.analysis.report.motion import point_path, read_motion
from hoap3.tools.analysis.report.motion_plots import motion_drawings
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_lockstep

ARMS = [("ur5", "qp12", "tool0"), ("lwr", "tsid", "ee"), ("humanoid32", "clik_sdp", "r_palm")]


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "config", "tool"), ARMS)
def test_of_an_arm_the_tool_is_shown_and_no_sole(robot, config, tool, tmp_path):
    sides = load_emulator_config(robot, [])[0], load_controller_config(config, [])[0]
    run_lockstep(*sides, 0.2, tmp_path / "run")
    motion = read_motion(Sources.open(tmp_path / "run"))
    assert motion.point == tool
    assert motion.sole_m is None
    assert not any("sole" in gap for gap in motion.gaps)
    error = np.linalg.norm((motion.path_m - motion.target_m)[[0, -1]], axis=1)
    assert 0.0 < error[1] < error[0] < 0.2
    drawings = {drawing.name: drawing for drawing in motion_drawings(motion)}
    assert "sole" not in drawings
    assert tool in drawings["path"].title
    assert len(drawings["positions"].keys) >= len(motion.joints[:6])


@pytest.mark.slow
def test_positions_are_shares_of_the_usable_range(tmp_path):
    sides = load_emulator_config("hoap3", [])[0], load_controller_config("qp12", [])[0]
    run_lockstep(*sides, 0.2, tmp_path / "run")
    sources = Sources.open(tmp_path / "run")
    motion, robot = read_motion(sources), sources.main.description
    assert motion.point == COM
    q = sources.main.states()["q"][0]
    expected = (q - robot.lower) / (robot.upper - robot.lower)
    np.testing.assert_allclose(motion.range_used[0], expected, atol=1e-3)
    path = point_path(q[None], robot, COM, "r_sole")
    np.testing.assert_allclose(motion.path_m[0], path[0], atol=1e-6)
    drawings = {drawing.name: drawing for drawing in motion_drawings(motion)}
    assert {"sole", "positions"} <= drawings.keys()


@pytest.mark.slow
def test_joints_without_limits_have_no_share_of_a_range(tmp_path):
    robot = str(write(tmp_path).parent)
    sides = load_emulator_config(robot, [])[0], load_controller_config("qp12", [])[0]
    run_lockstep(*sides, 0.1, tmp_path / "run")
    motion = read_motion(Sources.open(tmp_path / "run"))
    assert motion.joints == ("finger", "turn", "elbow", "lift", "roll")
    assert np.isnan(motion.range_used).all(axis=0).tolist() == [False, True, False, False, True]
    drawings = {drawing.name: drawing for drawing in motion_drawings(motion)}
    named = " ".join(key.text for key in drawings["positions"].keys)
    assert "finger" in named
    assert "turn" not in named
    endless = replace(motion, range_used=np.full_like(motion.range_used, np.nan))
    assert "positions" not in {drawing.name for drawing in motion_drawings(endless)}
