"""Any stream of accelerations or torques becomes a motion within the limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.strong_arms import changed, small, strong

from hoap3.protocol.limits.viability_bounds import acceleration_bounds
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.acceleration import REST, TORQUE_MARGIN, AccelerationFilter
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.position_servo import Plant
from hoap3.robot_emulator.plants.rigid_body import RigidBody
from hoap3.robot_emulator.robots import load

T = 0.001
HOLD_TICKS = 5
Command = np.ndarray | None  # None: nothing came
Attack = Callable[[np.random.Generator, int, Plant, np.ndarray], Command]


def randomly(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    return rng.uniform(-3.0, 3.0, most.size) * most


def bang_bang(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    """To one end of all ranges, then to the other, with all there is."""
    return most * (1.0 if tick // 1500 % 2 else -1.0)


def silence(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    """Bursts, with gaps of all lengths between them."""
    quiet = tick % 97 > 30 if tick % 7 else True
    return None if quiet else rng.uniform(-1.0, 1.0, most.size) * most


def at_the_wall(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    """Towards the nearest wall, with doubts."""
    return np.where(body.q > 0.0, most, -most) * (1.0 if rng.random() < 0.9 else -1.0)


def jumps(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    """Figures as no robot knows them, each for some time."""
    rng = np.random.default_rng(tick // 40)
    return rng.choice([-1e300, 1e300, 0.0, 5e-324, 1.0, -1.0], most.size) * most


def mixture(rng: np.random.Generator, tick: int, body: Plant, most: np.ndarray) -> Command:
    attacks = (randomly, bang_bang, silence, at_the_wall, jumps)
    return attacks[tick // 300 % len(attacks)](rng, tick, body, most)


ATTACKS = (randomly, bang_bang, silence, at_the_wall, jumps, mixture)


def filtered(description: RobotDescription) -> tuple[Plant, AccelerationFilter]:
    config = EmulatorConfig(robot="arm", hold_ticks=HOLD_TICKS)
    body, setpoint_filter = build_body(description, config)
    assert isinstance(setpoint_filter, AccelerationFilter)
    body.reset(description.initial_position)
    setpoint_filter.reset(description.initial_position)
    return body, setpoint_filter


def most_of(description: RobotDescription, kind: CommandKind) -> np.ndarray:
    return description.effort if kind == "torque" else 2.0 * description.brake_acceleration


def command_for(body: Plant, ddq: np.ndarray) -> np.ndarray:
    """What the robot takes for these accelerations."""
    command = ddq.copy()
    if isinstance(body, RigidBody):
        body.torques(ddq, T, command)
    return command


def attacked(
    description: RobotDescription, kind: CommandKind, attack: Attack, periods: int
) -> tuple[np.ndarray, AccelerationFilter]:
    """Largest excess over the limits: of the position, of the velocity, and accelerations per A."""
    body, setpoint_filter = filtered(description)
    rng, most = np.random.default_rng(3), most_of(description, kind)
    worst = np.full((3, description.n), -np.inf)
    for tick in range(periods):
        command = attack(rng, tick, body, most)
        if command is None:
            setpoint_filter.hold()
        else:
            setpoint_filter.follow(command, tick)
        before = body.dq.copy()
        body.step(setpoint_filter.value, T)
        outside = np.maximum(description.lower - body.q, body.q - description.upper)
        fast = np.abs(body.dq) - description.velocity
        asked = np.abs(setpoint_filter.value if kind == "acceleration" else (body.dq - before) / T)
        found = (outside, fast, asked / description.brake_acceleration)
        np.maximum(worst, found, out=worst)
    return worst.max(axis=1), setpoint_filter


@pytest.mark.parametrize("attack", ATTACKS)
def test_no_stream_of_accelerations_leaves_the_limits(attack: Attack):
    worst, setpoint_filter = attacked(strong("acceleration"), "acceleration", attack, 4000)
    assert np.all(worst <= (0.0, 0.0, 1.0))
    assert setpoint_filter.interventions


@pytest.mark.slow
@pytest.mark.parametrize("attack", ATTACKS)
def test_no_stream_of_torques_leaves_the_limits_where_efforts_suffice(attack: Attack):
    """Accelerations change within a period: by no more than a fifth here."""
    worst, setpoint_filter = attacked(strong("torque", "compensated"), "torque", attack, 3000)
    assert setpoint_filter.torque_limited == 0
    assert setpoint_filter.interventions
    assert np.all(worst <= (-0.9 * TORQUE_MARGIN[0], 0.0, 1.2))


@pytest.mark.long
@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_no_long_stream_leaves_the_limits(kind: CommandKind, attack: Attack):
    periods = 1_000_000 if kind == "acceleration" else 200_000
    worst, setpoint_filter = attacked(strong(kind), kind, attack, periods)
    assert setpoint_filter.torque_limited == 0
    assert np.all(worst <= (0.0, 0.0, 1.0 if kind == "acceleration" else 1.3))


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_what_keeps_the_limits_passes_bit_by_bit(kind: CommandKind):
    description = strong(kind, "compensated")
    body, setpoint_filter = filtered(description)
    rng = np.random.default_rng(0)
    for tick in range(300):
        ddq = 0.3 * rng.uniform(-1.0, 1.0, 7) * description.brake_acceleration
        command = command_for(body, ddq)
        assert setpoint_filter.follow(command, tick) == -1
        assert setpoint_filter.value.tobytes() == command.tobytes()
        body.step(setpoint_filter.value, T)
    assert setpoint_filter.interventions == setpoint_filter.torque_limited == 0


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_a_missing_setpoint_is_the_last_one_for_a_while_then_it_brakes_to_rest(kind: CommandKind):
    body, setpoint_filter = filtered(strong(kind, "compensated"))
    push = command_for(body, np.ones(7))
    for tick in range(100):
        setpoint_filter.follow(push, tick)
        body.step(setpoint_filter.value, T)
    for _ in range(HOLD_TICKS):
        setpoint_filter.hold()
        assert setpoint_filter.value.tobytes() == push.tobytes()
        body.step(setpoint_filter.value, T)
    top = np.abs(body.dq).max()
    assert top > 0.05
    speeds = []
    for _ in range(2000):
        setpoint_filter.hold()
        body.step(setpoint_filter.value, T)
        speeds.append(np.abs(body.dq).max())
    assert np.diff(speeds).max() <= 1e-3 * top
    assert speeds[-1] < 1e-3 * top
    setpoint_filter.follow(push, 3000)
    assert setpoint_filter.value.tobytes() == push.tobytes()


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_a_stop_goes_in_a_straight_line_at_the_braking_limit_of_one(kind: CommandKind):
    description = strong(kind, "compensated")
    body, setpoint_filter = filtered(description)
    speed = np.array([0.3, -0.1, 0.2, 0.05, 0.4, -0.3, 0.2])
    body.dq[:] = speed
    setpoint_filter.begin_stop()
    ticks = 0
    while not setpoint_filter.brake():
        body.step(setpoint_filter.value, T)
        ticks += 1
        along = body.dq @ speed / (speed @ speed)
        assert np.abs(body.dq - along * speed).max() < 5e-3
        assert ticks < 1000
    due = np.max(np.abs(speed) / description.brake_acceleration) / T
    assert ticks == pytest.approx(due, abs=3 if kind == "acceleration" else 30)
    assert np.abs(body.dq).max() <= 1e-3


def test_efforts_that_are_too_small_are_counted_and_name_the_joint():
    """Gravity pulls the elbow down, past what its motor can hold."""
    body, setpoint_filter = filtered(changed(small("torque"), effort=(20.0, 0.5, 20.0)))
    for tick in range(2000):
        setpoint_filter.follow(np.zeros(3), tick)
        body.step(setpoint_filter.value, T)
        if setpoint_filter.torque_limited:
            break
    assert setpoint_filter.torque_limited == 1
    assert setpoint_filter.overloaded == 1
    assert np.abs(setpoint_filter.value[1]) == 0.5


@pytest.mark.parametrize(("seed", "at_rest"), [(100, False), (107, True)])
def test_where_one_joint_lacks_efforts_the_others_keep_their_limits(seed: int, at_rest: bool):
    """Baxter with its own motors, thrown about, then stopped: only s1 may do what it must.

    In one case it comes to rest later than planned, in the other one only brakes can hold it.
    """
    arm = load("baxter_left_arm").model_copy(update={"command_kinds": ("torque",)})
    rng = np.random.default_rng(seed)
    start = tuple(rng.uniform(arm.lower, arm.upper))
    body, setpoint_filter = filtered(
        arm.model_copy(update={"postures": {arm.initial_posture: start}})
    )
    others = np.arange(7) != 1
    for tick in range(1500):
        if tick % 50 == 0:
            torques = rng.uniform(-1.0, 1.0, 7) * arm.effort
        if tick < 300:
            setpoint_filter.follow(torques, tick)
        elif tick == 300:
            setpoint_filter.begin_stop()
        if tick >= 300 and setpoint_filter.brake():
            break
        body.step(setpoint_filter.value, T)
        assert np.all(np.abs(body.dq)[others] <= arm.velocity[others])
        assert np.all((body.q >= arm.lower)[others] & (body.q <= arm.upper)[others])
    assert setpoint_filter.torque_limited > 50
    assert (np.abs(body.dq).max() <= REST) == at_rest
    assert np.abs(body.dq)[others].max() <= REST


def test_a_joint_lacks_efforts_only_while_it_does():
    description = changed(small("torque", "none"), effort=0.5)
    body, setpoint_filter = filtered(description)
    body.dq[1] = 3.0  # too fast
    setpoint_filter.follow(np.zeros(3), 0)
    assert setpoint_filter.overloaded == 1
    body.reset(description.initial_position)
    assert setpoint_filter.follow(np.zeros(3), 1) == -1
    assert (setpoint_filter.overloaded, setpoint_filter.torque_limited) == (-1, 1)


def test_a_torque_beyond_the_efforts_is_an_intervention_though_what_it_does_is_allowed():
    _, setpoint_filter = filtered(changed(small("torque", "none"), effort=1e-3))
    assert setpoint_filter.follow(np.array([0.0, 1e-3 * (1.0 + 1e-12), 0.0]), 0) == -1
    assert setpoint_filter.follow(np.array([0.0, 1.1e-3, 0.0]), 0) == 1
    assert (setpoint_filter.interventions, setpoint_filter.torque_limited) == (1, 0)


def test_what_is_held_in_a_gap_is_held_back_and_counted_as_well():
    _, setpoint_filter = filtered(small("acceleration"))
    setpoint_filter.follow(np.array([100.0, 0.0, 0.0]), 0)
    assert setpoint_filter.hold() == 0
    assert setpoint_filter.interventions == 2


def test_bounds_are_those_for_two_periods():
    arm = small("acceleration")
    body, setpoint_filter = filtered(arm)
    body.q[0], body.dq[0] = arm.upper[0] - 0.01, 0.63
    setpoint_filter.follow(np.full(3, 1e9), 0)
    A = arm.brake_acceleration
    limits = arm.lower, arm.upper, arm.velocity, A
    two = acceleration_bounds(body.q, body.dq, *limits, T, horizon_s=2 * T)[1]
    one = acceleration_bounds(body.q, body.dq, *limits, T)[1]
    np.testing.assert_allclose(setpoint_filter.value, two, atol=1e-3)
    assert one[0] > two[0] + 1.0


def test_a_joint_that_starts_outside_its_range_goes_no_further_out():
    arm = small("acceleration")
    posture = {"bent": (2.55, 1.0, -0.5)}  # the usable range ends at 2.5
    body, setpoint_filter = filtered(arm.model_copy(update={"postures": posture}))
    for tick in range(300):
        setpoint_filter.follow(np.array([100.0, 0.0, 0.0]), tick)
        body.step(setpoint_filter.value, T)
        assert body.q[0] <= 2.55
    setpoint_filter.follow(np.array([-1.0, 0.0, 0.0]), 300)
    assert setpoint_filter.value[0] == -1.0


def test_what_has_come_in_does_not_go_out_again_under_the_next_one_who_commands():
    arm = small("acceleration")
    posture = {"bent": (2.55, 1.0, -0.5)}  # the usable range ends at 2.5
    body, setpoint_filter = filtered(arm.model_copy(update={"postures": posture}))
    for outwards in range(2):
        setpoint_filter.forget()
        for tick in range(1500):
            push = 2.0 if outwards else -0.2
            setpoint_filter.follow(np.array([push, 0.0, 0.0]), tick)
            body.step(setpoint_filter.value, T)
            assert body.q[0] <= (2.5 if outwards else 2.55)
    assert body.q[0] > 2.49


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_a_brake_stronger_than_what_setpoints_may_is_used_as_far_as_they_may(kind: CommandKind):
    limits = {"brake_acceleration": 20.0, "setpoint_acceleration_max": 5.0, "effort": 1e3}
    body, setpoint_filter = filtered(changed(small(kind, "compensated"), **limits))
    push = command_for(body, np.full(3, 15.0))
    for tick in range(100):
        setpoint_filter.follow(push, tick)
        body.step(setpoint_filter.value, T)
    np.testing.assert_allclose(body.dq, 100 * 5.0 * T, rtol=0.05)
    setpoint_filter.begin_stop()
    ticks = 0
    while not setpoint_filter.brake():
        body.step(setpoint_filter.value, T)
        ticks += 1
    assert ticks == pytest.approx(100, abs=20)
