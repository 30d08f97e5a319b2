"""What a frame says is what its State and its Setpoint say."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import hoap3
from hoap3.protocol.messages import Setpoint, State
from hoap3.tools.view.picture.changeable import sliders
from hoap3.tools.view.picture.frame import Frames
from hoap3.tools.view.picture.geometry import looks_of
from hoap3.tools.view.picture.kinematics import Poses

ROBOT = hoap3.load_robot("hoap3")


@pytest.fixture
def frames() -> Frames:
    return Frames(ROBOT, looks_of(ROBOT), {"extra": ["gamma"]})


@pytest.fixture
def state() -> State:
    made = State.allocate(**ROBOT.state_lengths)
    made.q[:] = ROBOT.initial_position
    made.tick, made.stamp_published, made.mode = 2_345, 987_654_321, State.ACTIVE
    made.late, made.lost, made.skipped, made.success_rate = 3, 4, 5, 0.93
    return made


def answer(state: State, extra: float = 0.0) -> Setpoint:
    made = Setpoint(ROBOT.n, 1)
    made.tick = state.tick
    made.v, made.v_rate_required, made.rho, made.margin = 0.02, -0.4, 1.0, 1e-3
    made.active_joints, made.extra[0] = 6, extra
    made.stamp_received, made.stamp_encoded = 1_000_000, 1_150_000
    return made


def test_a_frame_is_of_its_state(frames, state):
    found = frames.frame(state, answer(state, 0.5))
    assert (found["tick"], found["time_s"], found["stamp_ns"]) == (2345, 2.345, 987_654_321)
    assert found["mode"] == "active"
    poses = Poses(ROBOT)
    poses.update(state.q)
    assert np.allclose(found["poses"], poses.poses, atol=1e-6)
    assert np.allclose(found["com"], poses.com, atol=1e-6)
    assert len(found["polygon"]) == 4  # the right sole, which the robot stands on
    values = found["values"]
    assert values["error"] == pytest.approx(math.sqrt(0.04))
    assert (values["v"], values["v_rate_required"], values["margin"]) == (0.02, -0.4, 1e-3)
    assert (values["misses"], values["skipped"], values["success_rate"]) == (7, 5, 0.93)
    assert (values["active_joints"], values["cycle_us"], values["extra.0"]) == (6, 150.0, 0.5)


def test_every_value_is_one_that_is_plotted(frames, state):
    keys = {plot["key"] for plot in frames.plots()}
    assert frames.frame(state, answer(state))["values"].keys() <= keys
    assert "extra.0" in keys


def test_what_is_not_known_is_none(frames, state):
    silent = frames.frame(state, None)["values"]
    assert "v" not in silent
    setpoint = answer(state, math.nan)
    setpoint.v = math.inf
    found = frames.frame(state, setpoint)["values"]
    assert found["v"] is found["extra.0"] is found["error"] is None
    setpoint.solver_status = Setpoint.schema.constants["STATUS_NONE"]
    assert "margin" not in frames.frame(state, setpoint)["values"]


def test_all_of_it_is_json(frames, state):
    for content in (frames.hello(), frames.frame(state, answer(state))):
        assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_the_speed_of_a_joint_is_judged_by_its_limit(frames, state):
    state.dq[3] = -0.5 * ROBOT.velocity[3]
    found = frames.frame(state, None)["values"]
    assert found["speed_share"] == pytest.approx(0.5)
    assert found["fastest"] == pytest.approx(0.5 * ROBOT.velocity[3])


def test_sliders_have_the_bounds_that_the_controller_tells():
    now = {"gamma": 0.5, "tasks": {"hand": {"kp": 10.0}}}
    numbers = [
        {"key": "gamma", "meaning": "of the norm", "lower": 0.0, "upper": 1.0},
        {"key": "tasks.hand.kp", "meaning": "of the error [1/s²]", "lower": 0.0, "upper": None},
    ]
    gamma, kp = sliders(now, numbers)
    assert (gamma["key"], gamma["value"], gamma["lower"], gamma["upper"]) == ("gamma", 0.5, 0, 1)
    assert (kp["key"], kp["label"], kp["unit"]) == ("tasks.hand.kp", "of the error", "1/s²")
    words = {"names": ["a"], "alpha": [[0.0]], "on": True, "few": [1.0, 2.0], "none": None}
    assert [each["key"] for each in sliders(words, [])] == ["few", "none"]
    assert sliders(None, None) == sliders("x", 3) == []
    assert sliders(now, None)[0]["lower"] is None
    assert sliders(now, [{"key": []}, {"key": None}, 3, *numbers]) == [gamma, kp]


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
@pytest.mark.parametrize("array", ["q", "base"])
def test_a_state_that_does_not_say_where_it_is_does_not_fit(array, wrong):
    robot = ROBOT.model_copy(update={"state_arrays": {"base": 13}})
    frames, state = Frames(robot, looks_of(robot)), State.allocate(**robot.state_lengths)
    state.base[6] = 1.0
    assert frames.fits(state)
    getattr(state, array)[2] = wrong
    assert not frames.fits(state)


@pytest.mark.parametrize("array", ["contact", "dq"])
def test_of_a_state_that_says_where_it_is_the_rest_may_be_unknown(array):
    robot = ROBOT.model_copy(update={"state_arrays": {"base": 13, "contact": 12}})
    frames, state = Frames(robot, looks_of(robot)), State.allocate(**robot.state_lengths)
    state.base[6], state.contact[2] = 1.0, 30.0
    assert frames.frame(state, None)["zmp"] is not None
    getattr(state, array)[3] = math.nan
    assert frames.fits(state)
    found = frames.frame(state, None)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert (found["zmp"] is None) == (array == "contact")
    assert (found["values"]["fastest"] is None) == (array == "dq")
