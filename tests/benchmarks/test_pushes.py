"""How hard standing robots may be pushed: bounds in figures, and pushes that are survived."""

import json
import math

import numpy as np
import pytest

from benchmarks.pushes import __main__ as front
from benchmarks.pushes.capture import Stance, impulse, room, room_by_torques
from benchmarks.pushes.trials import greatest_share, stance_of, survives
from hoap3.robot_emulator.robots import load

MARGIN = 0.005
SOLE_X, SOLE_Y, APART = 0.054, 0.0365, 0.088  # m, of HOAP-3 in its posture q0
COM = np.array([-0.0085, 0.0279, 0.2868])  # m, seen from the right sole
MASS = 8.8024  # kg


@pytest.fixture(scope="module")
def stance() -> Stance:
    robot = load("hoap3")
    base = np.zeros(13)
    base[6] = 1.0
    found = Stance(robot, base, np.array(robot.initial_position), 0.7, MARGIN)
    base[:3] = -found.dynamics().origins[0]
    return found


@pytest.mark.parametrize(
    ("angle_deg", "distance"),
    [
        (0, SOLE_X - MARGIN - COM[0]),
        (180, SOLE_X - MARGIN + COM[0]),
        (90, APART + SOLE_Y - MARGIN - COM[1]),
        (270, SOLE_Y - MARGIN + COM[1]),
    ],
)
def test_room_is_that_of_both_soles_less_the_margin(stance, angle_deg, distance):
    found = room(stance, math.radians(angle_deg))
    assert found == pytest.approx(distance, abs=2e-4)
    bound = MASS * math.sqrt(9.81 / COM[2]) * distance
    assert impulse(stance, found) == pytest.approx(bound, rel=5e-3)


def test_torques_are_no_limit_until_they_are_small(stance):
    free = room(stance, 0.0)
    assert room_by_torques(stance, 0.0) == pytest.approx(free, rel=5e-3)
    robot = stance.robot
    less = {"effort": 0.9, "effort_average": 0.9}
    weaker = tuple(
        joint.model_copy(update=less if "ankle_pitch" in joint.name else {})
        for joint in robot.joints
    )
    weak = Stance(robot.model_copy(update={"joints": weaker}), stance.base, stance.q, 0.7, MARGIN)
    reached = room_by_torques(weak, 0.0)
    assert 0.0 < reached < 0.7 * free
    slippery = Stance(robot, stance.base, stance.q, 0.1, MARGIN)
    assert room_by_torques(slippery, 0.0) < free


@pytest.mark.parametrize(
    ("lost", "share"),
    [({0.6, 0.7}, 0.5), ({1.0}, 0.9), ({1.4}, 1.3), (set(), 1.4)],
    ids=["a gap", "at 100 %", "at the last", "never"],
)
def test_a_share_counts_only_where_all_smaller_pushes_are_survived(lost, share):
    assert greatest_share(lambda tried: tried not in lost) == pytest.approx(share)
    assert greatest_share(lambda _: False) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("angle_deg", [0, 90, 180, 225])
@pytest.mark.parametrize("controller", ["tsid_standing", "ghc_standing"])
def test_hoap3_survives_what_is_wanted_and_not_twice_as_much(controller, angle_deg):
    angle = math.radians(angle_deg)
    standing = stance_of("hoap3_standing_torque", controller)
    bound = impulse(standing, room(standing, angle))
    share = 0.8 if angle_deg % 90 == 0 else 0.6
    assert survives("hoap3_standing_torque", controller, share * bound, angle)
    assert not survives("hoap3_standing_torque", controller, 2.0 * bound, angle)


@pytest.mark.long
@pytest.mark.parametrize("controller", ["tsid_standing_humanoid", "ghc_standing_humanoid"])
def test_the_humanoid_survives_a_push_from_behind(controller):
    standing = stance_of("humanoid32_standing", controller)
    bound = impulse(standing, room(standing, 0.0))
    assert survives("humanoid32_standing", controller, 0.8 * bound, 0.0)


@pytest.mark.parametrize(("share", "code"), [(0.8, 0), (0.7, 1)])
def test_the_command_ends_with_1_where_less_than_wanted_is_survived(
    share, code, monkeypatch, run_command
):
    row = dict.fromkeys(("room_m", "bound_ns", "torque_bound_ns", "survived_ns"), 1.0)
    row |= {"robot": "r", "controller": "c", "direction_deg": 0, "share": share, "wanted": 0.8}
    monkeypatch.setattr(front, "bench_pushes", lambda *_: [row])
    done = run_command(front.command, "--json")
    assert done.exit_code == code
    assert json.loads(done.stdout).keys() == {"rows", "machine"}
    assert f"{1 - code} of 1" in run_command(front.command).stdout
