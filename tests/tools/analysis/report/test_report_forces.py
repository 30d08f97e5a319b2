"""What a report says of robots that take accelerations or torques."""

from __future__ import annotations

import numpy as np
import pytest
from report_logs import active_log

from hoap3.protocol.messages import Setpoint
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.motion import read_motion
from hoap3.tools.analysis.report.motion_plots import motion_drawings
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.logs.log import Log
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_lockstep

pytestmark = pytest.mark.slow

STATUS_NONE = Setpoint.schema.constants["STATUS_NONE"]


@pytest.mark.parametrize(
    ("command", "unit"), [(Setpoint.ACCELERATION, "rad/s²"), (Setpoint.TORQUE, "N m")]
)
def test_inputs_have_their_unit_and_joints_that_move_are_those_that_were_seen_to(
    tmp_path, command, unit
):
    path = active_log(tmp_path, setpoint={"command": command, "solver_status": STATUS_NONE})
    motion = read_motion(Sources.open(path))
    states = Log.open(path, "robot").states()
    assert motion.unit == unit
    assert np.array_equal(motion.active, (np.abs(states["dq"]) >= 1e-3).sum(axis=1))
    (drawing,) = [each for each in motion_drawings(motion) if each.name == "u"]
    assert "2 of 2" in drawing.title
    assert drawing.figures.endswith(unit)


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    """A run of Baxter's arm, stretched forward, where its shoulder cannot hold it."""
    folder = tmp_path_factory.mktemp("weak") / "run"
    emulator, _ = load_emulator_config("baxter", ["posture=zero"])
    changes = ["parameters.goal.posture=zero"]
    summary = run_lockstep(emulator, load_controller_config("tsid_baxter", changes)[0], 0.3, folder)
    return folder, summary


def test_efforts_that_were_too_small_stand_at_the_head_and_in_the_figures(weak):
    content = read_content(weak[0])
    count = weak[1]["torque_limited"]
    assert count > 0
    assert content.as_json()["torque_limited"] == count
    assert f" {count} " in " ".join(content.gaps)


def test_the_centre_of_mass_is_not_seen_from_the_hand_that_moves(weak):
    assert read_motion(Sources.open(weak[0])).frame == "base"
