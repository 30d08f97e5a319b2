"""What the robot counts of its body: joints beyond their stops, a free base that falls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.robot_bench import Bench
from support.small_arm import arm

from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.body_watch import BEYOND_RAD, BodyWatch
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.robot_log import check_body

ROBOT = arm()  # its stops are at 2.1 rad on both sides
TICKS = 20


def states(rows: list[tuple[float, ...]], base: np.ndarray | None = None) -> np.ndarray:
    """States with these positions, and bases, (N, 13)."""
    base = np.zeros((len(rows), 0)) if base is None else base
    names = [("tick", "i8"), ("q", "f8", (ROBOT.n,)), ("base", "f8", (base.shape[1],))]
    table = np.zeros(len(rows), dtype=names)
    table["tick"], table["q"], table["base"] = np.arange(len(rows)), rows, base
    return table


def watched(table: np.ndarray, robot: RobotDescription = ROBOT) -> dict[str, object]:
    q, base = np.zeros(robot.n), np.zeros(table["base"].shape[1])
    watch = BodyWatch(robot, q, base)
    for state in table:
        q[:], base[:] = state["q"], state["base"]
        watch.look(int(state["tick"]))
    return watch.summary()


def falling(degrees: float) -> np.ndarray:
    """A base that turns on the spot by 90 degrees, then tilts about a level axis, and sinks."""
    base = np.zeros((TICKS, 13))
    for tick in range(TICKS):
        share = tick / (TICKS - 1)
        yaw, tilt = math.pi / 4.0 * min(1.0, 2.0 * share), math.radians(degrees) * share / 2.0
        z, x = (math.cos(yaw), math.sin(yaw)), (math.cos(tilt), math.sin(tilt))
        base[tick, 3:7] = z[0] * x[1], z[1] * x[1], z[1] * x[0], z[0] * x[0]
        base[tick, 2] = 0.5 - 0.3 * share
    return base


def test_a_joint_counts_from_half_a_degree_beyond_its_stops_on():
    near, beyond = 2.1 + BEYOND_RAD - 1e-9, 2.1 + BEYOND_RAD + 1e-9
    assert watched(states([(0.0, near, -near)]))["beyond_stops"] is None
    told = watched(states([(0.0, 0.0, 0.0), (0.0, -beyond, 0.0)]))["beyond_stops"]
    assert told["periods"] == told["first_tick"] == 1
    assert told["first"] == told["furthest"] == ROBOT.joint_names[1]
    assert told["furthest_by"] == pytest.approx(BEYOND_RAD + 1e-9)


def test_the_first_joint_is_named_and_the_one_that_went_furthest():
    rows = [(0.0, 0.0, 0.0), (2.2, 0.0, 0.0), (2.2, 0.0, -19.6), (0.0, 0.0, 0.0), (0.0, 3.0, 0.0)]
    told = watched(states(rows))["beyond_stops"]
    first, _, furthest = ROBOT.joint_names
    assert (told["first"], told["first_tick"], told["periods"]) == (first, 1, 3)
    assert (told["furthest"], told["unit"]) == (furthest, "rad")
    assert told["furthest_by"] == pytest.approx(17.5)


def test_a_prismatic_joint_is_judged_in_metres():
    robot = arm(urdf=ROBOT.urdf.replace('"wrist" type="revolute"', '"wrist" type="prismatic"'))
    assert watched(states([(0.0, 0.0, 2.1009)]), robot)["beyond_stops"] is None
    told = watched(states([(0.0, 0.0, 2.1011)]), robot)["beyond_stops"]
    assert (told["furthest"], told["unit"]) == ("wrist", "m")


@pytest.mark.parametrize("degrees", [30.0, 44.0, 46.0, 180.0])
def test_a_base_that_turns_does_not_tilt_and_one_that_falls_does(degrees):
    told = watched(states([(0.0, 0.0, 0.0)] * TICKS, falling(degrees)))["base"]
    assert told["largest_tilt_deg"] == pytest.approx(degrees, abs=1e-5)
    assert told["tilt_deg"] == pytest.approx(degrees, abs=1e-5)
    assert (told["fallen_tick"] is None) == (degrees < 45.0)
    assert told["moved_m"] == pytest.approx([0.0, 0.0, -0.3])


def test_a_base_that_stands_up_again_has_fallen_all_the_same():
    there = falling(90.0)
    told = watched(states([(0.0, 0.0, 0.0)] * 2 * TICKS, np.concatenate([there, there[::-1]])))
    assert told["base"]["tilt_deg"] == pytest.approx(0.0, abs=1e-5)
    assert told["base"]["largest_tilt_deg"] == pytest.approx(90.0)


def test_a_robot_looks_at_every_state_that_it_publishes():
    bench = Bench()
    bench.link.ask("acquire", "test")
    bench.run(5)
    assert bench.robot.summary()["beyond_stops"] is None

    def blow_up(command: np.ndarray, dt: float) -> None:
        bench.robot.plant.q[2] = 19.0

    bench.robot.plant.step = blow_up
    bench.run(10)
    shown = [state.tick for state in bench.states() if state.q[2] > 2.2]
    told = bench.robot.summary()["beyond_stops"]
    assert (told["first_tick"], told["periods"]) == (shown[0], len(shown)) == (5, 10)
    assert bench.states()[-1].mode == State.ACTIVE


def verified(told: dict[str, object], table: np.ndarray) -> bool:
    claims = Claims()
    check_body(told, table, ROBOT, claims)
    return claims.false == 0


ROWS = [(0.0, 0.0, 0.0)] * 5 + [(2.2, 0.0, -19.6)] * 3 + [(0.0, 0.0, 0.0)] * (TICKS - 8)


def test_what_a_robot_says_of_its_body_is_verified_against_its_states():
    table = states(ROWS, falling(80.0))
    assert verified(watched(table), table)
    assert verified({}, table)  # of a version before
    fine = states([(0.0, 0.0, 0.0)] * TICKS, falling(0.0))
    assert verified(watched(fine), fine)


@pytest.mark.parametrize(
    ("name", "key", "lie"),
    [
        ("beyond_stops", "periods", 2),
        ("beyond_stops", "first_tick", 4),
        ("beyond_stops", "first", "shoulder"),
        ("beyond_stops", "furthest", "shoulder"),
        ("beyond_stops", "furthest_by", 0.1),
        ("base", "tilt_deg", 0.1),
        ("base", "largest_tilt_deg", 44.0),
        ("base", "fallen_tick", None),
        ("base", "moved_m", [0.0, 0.0, 0.0]),
    ],
)
def test_a_lie_about_the_body_is_found(name, key, lie):
    table = states(ROWS, falling(80.0))
    told = watched(table)
    assert not verified({**told, name: {**told[name], key: lie}}, table)
    assert not verified({**told, "beyond_stops": None}, table)
