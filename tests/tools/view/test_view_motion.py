"""What a page moves, when it is held, and where it comes to rest; on a clock of the test's own."""

from __future__ import annotations

import numpy as np
import pytest
import view_samples
from view_samples import BOUNDS, HAND, config_of, posed, task

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.remote_controller.references.live.live import Live
from hoap3.remote_controller.references.live.live_plan import Bounds
from hoap3.tools.picture.poses import Poses
from hoap3.tools.view.picture.frame import Frames
from hoap3.tools.view.picture.geometry import Looks
from hoap3.tools.view.steering.hold import (
    braking_distance,
    multiplied,
    of_rotation_vector,
    rest_of,
    rotation_vector,
)
from hoap3.tools.view.steering.motion import Motion

UR5 = view_samples.UR5.model_copy(update={"state_arrays": {"reference_rate": 6}})
TURNS = {"speed": [0.5] * 3, "acceleration": [2.0] * 3, "jerk": [40.0] * 3}
POSE = {
    "dimension": 7,
    "rates": 6,
    "layout": [],
    **{key: BOUNDS[key] + TURNS[key] for key in BOUNDS},
}
JOINTS = {"dimension": 6, "rates": 6, "layout": list(UR5.joint_names), "unit": "rad"}
TARGETS = [
    {**HAND, **BOUNDS},
    {**HAND, **POSE, "name": "tool"},
    {"name": "arm", **JOINTS, **{key: 2 * turns for key, turns in TURNS.items()}},
]
KINDS = {"hand": "frame_position", "tool": "frame_pose", "arm": "posture"}


@pytest.fixture
def frames() -> Frames:
    config = config_of(*(task(kind, target=name) for name, kind in KINDS.items()))
    return Frames(UR5, Looks({}), {"config": config, "targets": TARGETS})


@pytest.fixture
def state() -> State:
    made = State.allocate(**UR5.state_lengths)
    made.q[:] = made.reference[:] = UR5.initial_position
    return made


@pytest.fixture
def motion(frames, state) -> Motion:
    made = Motion(lambda: frames, lambda: state)
    made.begin(100.0)
    return made


def place(state: State) -> np.ndarray:
    return np.array(posed(UR5, state.reference).pose("tool0"))


def test_what_is_dragged_is_sent_once_and_the_newest_alone(motion):
    motion.drag("hand", [0.1, 0.2, 0.3], 100.0)
    motion.drag("hand", [0.4, 0.5, 0.6], 100.0)
    assert motion.step(100.02) == {"hand": [0.4, 0.5, 0.6]}
    assert motion.step(100.04) == {}


def test_silence_of_more_than_120_ms_holds_what_moves(motion, state):
    motion.drag("hand", [0.4, 0.5, 0.6], 100.0)
    motion.step(100.0)
    for now in np.arange(100.02, 101.0, 0.02):
        motion.beat(now)
        assert motion.step(now) == {}
    assert motion.step(now + 0.119) == {}
    held = motion.step(now + 0.121)
    assert np.allclose(held["hand"], place(state)[:3], atol=1e-9)
    assert motion.step(now + 0.3) == {}
    assert not motion.moves


def test_silence_at_rest_moves_nothing(motion):
    motion.drag("hand", [0.4, 0.5, 0.6], 100.0)
    motion.step(100.0)
    motion.hold()
    motion.step(100.02)
    assert motion.step(101.9) == {}
    assert not motion.is_gone(101.9)
    assert motion.is_gone(102.1)


@pytest.mark.parametrize("holds", [1, 2])  # the first is not sent yet when another one comes
def test_a_hold_of_what_was_moved_alone_replaces_what_was_not_sent_yet(motion, state, holds):
    motion.drag("hand", [0.4, 0.5, 0.6], 100.0)
    for _ in range(holds):
        motion.hold()
        assert motion.waits
    held = motion.step(100.01)
    assert held.keys() == {"hand"}
    assert np.allclose(held["hand"], place(state)[:3], atol=1e-9)
    assert not motion.waits


def test_a_velocity_leads_on_from_where_the_robot_is_for_150_ms(motion, state):
    begin = place(state)[:3]
    motion.drive("hand", [0.1, 0.0, -0.05], 100.0)
    sent = [motion.step(now)["hand"] for now in (100.02, 100.04, 100.1)]
    for values, gone in zip(sent, (0.02, 0.04, 0.1), strict=True):
        assert np.allclose(values, begin + gone * np.array([0.1, 0.0, -0.05]), atol=1e-9)
    motion.beat(100.16)
    assert np.allclose(motion.step(100.16)["hand"], begin, atol=1e-9)  # held: it never moved
    assert motion.step(100.3) == {}


def test_a_velocity_is_no_more_than_the_target_takes(motion, state):
    motion.drive("hand", [9.0, 0.0, 0.0], 100.0)
    assert np.allclose(motion.step(100.1)["hand"] - place(state)[:3], [0.025, 0, 0], atol=1e-9)


def test_a_target_that_is_driven_waits_for_a_robot_that_does_not_follow(motion, state):
    now = 100.0
    while now < 110.0:
        motion.drive("hand", [0.25, 0.0, 0.0], now)
        sent = motion.step(now)
        now += 0.05
    assert np.linalg.norm(sent["hand"] - place(state)[:3]) <= 0.5 * 0.25 + 1e-9


def test_a_pose_is_turned_about_axes_of_its_reference(motion, state):
    motion.drive("tool", [0, 0, 0, 0, 0, 0.4], 100.0)
    sent = np.array(motion.step(100.1)["tool"])
    here = place(state)
    turned = multiplied(of_rotation_vector(np.array([0, 0, 0.04])), here[3:])
    assert np.allclose(sent[:3], here[:3], atol=1e-9)
    assert np.allclose(abs(turned @ sent[3:]), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("foot", [0.0, 0.0, 0.0]),
        (None, [0.0, 0.0, 0.0]),
        ("hand", [0.0, 0.0]),
        ("hand", [0.0, 0.0, float("nan")]),
        ("hand", [0.0, 0.0, 10**400]),
        ("hand", [0.0, 0.0, True]),
        ("hand", ["0", 0.0, 0.0]),
        ("hand", None),
        ("hand", {"x": 1}),
    ],
)
def test_wrong_words_move_nothing(motion, name, values):
    for take in (motion.drag, motion.drive):
        with pytest.raises(UsageError):
            take(name, values, 100.0)
    assert motion.step(100.02) == {}
    assert not motion.moves


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.25])
def test_a_live_target_that_is_sent_to_its_braking_distance_does_not_come_back(speed):
    """By ruckig itself, from steady motion: no overshoot beyond 1 % of the way."""
    live = Live("x", "m", Bounds(speed, 1.0, 20.0), np.full(1, -9.0), np.full(1, 9.0))
    live.start(np.zeros(1), 0.0)
    assert live.take(0.0, 1.0, np.array([[5.0]]), np.zeros((0, 1)), 0.0) == 0
    where, rate = np.zeros(1), np.zeros(1)
    live.at(2.0, where, rate)
    way = braking_distance(float(rate[0]), 1.0, 20.0)
    rest = float(where[0]) + way
    assert live.take(2.0, 1.0, np.array([[rest]]), np.zeros((0, 1)), 2.0) == 0
    seen = []
    for time_s in np.arange(2.0, 4.0, 0.001):
        live.at(time_s, where, rate)
        seen.append(float(where[0]))
    assert max(seen) <= rest + 0.01 * way
    assert seen[-1] == pytest.approx(rest, abs=1e-6)


def test_a_hold_in_motion_is_ahead_by_the_braking_distance(frames, state):
    state.reference_rate[:] = [0.2, -0.1, 0.05, 0.1, 0.0, -0.1]
    poses = Poses(UR5)
    hand, tool, arm = frames.targets
    dt = 1e-6
    begin = place(state)
    state_later = State.allocate(**UR5.state_lengths)
    state_later.reference[:] = state.reference + dt * state.reference_rate
    end = place(state_later)
    velocity = (end - begin)[:3] / dt
    expected = begin[:3] + [np.sign(v) * braking_distance(abs(v), 1, 20) for v in velocity]
    assert np.allclose(rest_of(hand, state, poses, None), expected, atol=1e-4)
    rest = rest_of(tool, state, poses, None)
    assert np.allclose(rest[:3], expected, atol=1e-4)
    turn = multiplied(end[3:], begin[3:] * [-1, -1, -1, 1])
    omega = rotation_vector(turn) / dt
    ways = [np.sign(w) * braking_distance(abs(w), 2.0, 40.0) for w in omega]
    aim = multiplied(of_rotation_vector(np.array(ways)), begin[3:])
    assert abs(aim @ rest[3:]) == pytest.approx(1.0, abs=1e-6)
    ways = [np.sign(v) * braking_distance(abs(v), 2.0, 40.0) for v in state.reference_rate]
    assert np.allclose(rest_of(arm, state, poses, None), state.reference + ways, atol=1e-6)


def test_a_hold_goes_no_further_than_what_was_asked_for(frames, state):
    state.reference_rate[:] = [0.2, -0.1, 0.05, 0.1, 0.0, -0.1]
    poses, (hand, *_) = Poses(UR5), frames.targets
    here = place(state)[:3].tolist()
    assert np.allclose(rest_of(hand, state, poses, here), here, atol=1e-12)


def test_a_hold_keeps_to_the_bit_what_rests_where_it_was_sent(frames, state):
    """The dragged axis brakes; the others, and the orientation, do not change by rounding."""
    here = place(state)
    aside = np.array([0.2, 3e-4, -1e-5, *np.zeros(4)])
    asked = (here + aside).tolist()
    asked[3:] = [-each for each in asked[3:]]  # the same orientation
    (target,) = (each for each in frames.targets if each.name == "tool")
    rest = rest_of(target, state, Poses(UR5), asked)
    assert rest[0] == pytest.approx(here[0], abs=1e-9)
    assert rest[1:] == asked[1:]
    asked[1], asked[3:] = here[1] + 0.01, multiplied(of_rotation_vector(0.01 * here[:3]), here[3:])
    rest = rest_of(target, state, Poses(UR5), asked)
    assert rest[1] == pytest.approx(here[1], abs=1e-9)
    assert abs(np.dot(rest[3:], here[3:])) == pytest.approx(1.0, abs=1e-12)


def test_other_targets_of_the_controller_end_what_was_driven(frames, state):
    """The same name, but a pose now: rates of before do not fit it."""
    present = [frames]
    motion = Motion(lambda: present[0], lambda: state)
    motion.begin(100.0)
    motion.drive("hand", [0.1, 0.0, 0.0], 100.0)
    assert motion.step(100.02).keys() == {"hand"}
    about = {"config": config_of(task("frame_pose")), "targets": [{**HAND, **POSE}]}
    present[0] = Frames(UR5, Looks({}), about)
    assert motion.step(100.04) == {}
    assert not motion.moves
    motion.drive("hand", [0.0, 0.0, 0.0, 0.0, 0.0, 0.1], 100.05)
    assert len(motion.step(100.06)["hand"]) == 7


@pytest.mark.parametrize("array", ["q", "reference", "reference_rate"])
def test_a_state_that_is_no_number_moves_nothing(motion, state, array):
    motion.drive("hand", [0.1, 0.0, 0.0], 100.0)
    getattr(state, array)[2] = np.nan
    assert motion.step(100.02) == {}
    motion.hold()
    assert motion.step(100.04) == {}
