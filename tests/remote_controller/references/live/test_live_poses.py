"""Live orientations and poses: bounded, without a jump, the shorter way, exactly on the curve."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.references.live.live import Live, Turning
from hoap3.remote_controller.references.live.live_plan import Bounds

T = 1e-3
BOUNDS, TURNS = Bounds(0.25, 1.0, 20.0), Bounds(0.5, 2.0, 40.0)
NO_RATES = np.zeros((0, 6))
ANYWHERE = np.full(3, 2.0)
HOME = np.array([0.3, -0.1, 0.5, 0.4, -0.7, 1.1])
TURN = Rotation.from_rotvec(HOME[3:])
SPIN = np.array([0.1, 0.15, -0.2])  # rad/s, about which it turns steadily


def live(within_rad: float = math.pi, around: np.ndarray | None = None, **more) -> Live:
    """One that began at `HOME` at time 0."""
    turning = Turning(TURNS, around, within_rad)
    made = Live("hand", "m", BOUNDS, -ANYWHERE, ANYWHERE, turning=turning, **more)
    made.start(HOME, 0.0)
    return made


def pose(turns: Rotation, places: np.ndarray = HOME[:3]) -> np.ndarray:
    """Points of a message, (p, 7)."""
    quaternions = np.atleast_2d(turns.as_quat())
    return np.hstack([np.broadcast_to(places, (len(quaternions), 3)), quaternions])


def turning(time_s: np.ndarray) -> Rotation:
    """An orientation that swings about one axis and turns steadily about another."""
    time_s = np.atleast_1d(time_s)
    swing = Rotation.from_rotvec(np.outer(0.3 * np.sin(1.2 * time_s), [0.0, 0.6, 0.8]))
    return Rotation.from_rotvec(np.outer(time_s, SPIN)) * swing * TURN


def motion(target: Live, ticks: range) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Positions (ticks, 3), orientations, and angular velocities (ticks, 3) that it states."""
    place, speed = np.zeros((2, 6))
    seen, rates = np.zeros((2, len(ticks), 6))
    for row, tick in enumerate(ticks):
        target.at(tick * T, place, speed)
        seen[row], rates[row] = place, speed
    return seen[:, :3], Rotation.from_rotvec(seen[:, 3:]), angular(seen[:, 3:], rates[:, 3:])


def angular(vectors: np.ndarray, rates: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """ω of rotation vectors that change so, by central differences."""
    ahead, behind = (Rotation.from_rotvec(vectors + h * rates) for h in (step, -step))
    return (ahead * behind.inv()).as_rotvec() / (2.0 * step)


def assert_bounded(turns: Rotation, *, fast: float = 1.0) -> None:
    """Nothing jumps: ω, its rate and the rate of that are what bounds of r̈ and r⃛ allow.

    Of a rotation vector r, Jl(r) = ∫ exp(u[r]) du over 0 … 1: |ω| ≤ |ṙ|, |ω̇| ≤ |r̈| + ½|ṙ|² and
    |ω̈| ≤ |r⃛| + 3/2·|ṙ||r̈| + ⅓|ṙ|³, and of each three components √3 times a bound.
    """
    b, a, j = math.sqrt(3.0) * np.array([TURNS.speed, TURNS.acceleration, TURNS.jerk])
    most = b, a + 0.5 * b * b, j + 1.5 * a * b + b**3 / 3.0
    found = (turns[1:] * turns[:-1].inv()).as_rotvec() / T
    for bound in most:
        assert np.linalg.norm(found, axis=1).max() <= fast * bound * (1.0 + 1e-3)
        found = np.diff(found, axis=0) / T


@pytest.mark.slow
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_comes_orientation_and_angular_velocity_are_continuous(seed):
    rng, target, path = np.random.default_rng(seed), live(), []
    place, speed = np.zeros((2, 6))
    taken = 0
    for tick in range(1000):
        if rng.random() < 0.03:
            first = tick + int(rng.integers(-300, 300))
            count, step = int(rng.integers(1, 8)), int(rng.integers(1, 100))
            times = step * T * np.arange(count)
            here = Rotation.from_rotvec(rng.normal(scale=0.02, size=3) + place[3:])
            turns = Rotation.from_rotvec(np.outer(times, rng.normal(scale=0.15, size=3))) * here
            if count == 1:
                turns = Rotation.random(1, rng=rng)
            rates = rng.normal(scale=0.05, size=(count, 6))[: count * int(rng.integers(2))]
            given_ = first * T, step * T, pose(turns, place[:3]), rates, (tick + 1) * T
            taken += isinstance(target.take(*given_), int)
        target.at(tick * T, place, speed)
        path.append(place.copy())
    assert_bounded(Rotation.from_rotvec(np.array(path)[:, 3:]))


def test_the_angular_velocity_is_that_of_the_orientation():
    target = live()
    target.take(0.0, 0.05, pose(turning(0.05 * np.arange(30))), NO_RATES, 0.001)
    target.take(0.9, T, pose(Rotation.from_rotvec([2.0, 1.0, 0.5])), NO_RATES, 0.901)
    _, turns, omega = motion(target, range(4000))
    found = (turns[2:] * turns[:-2].inv()).as_rotvec() / (2.0 * T)
    np.testing.assert_allclose(found, omega[1:-1], atol=40.0 * T * T)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_turns_the_shorter_way_about_one_axis_and_stays(side):
    target, axis = live(), np.array([0.6, 0.0, 0.8])
    aim = Rotation.from_rotvec(3.0 * axis) * TURN
    points = pose(aim)
    points[:, 3:] *= side
    assert target.take(0.0, T, points, NO_RATES, 0.001) == 0
    _, turns, omega = motion(target, range(9000))
    assert (turns[-1] * aim.inv()).magnitude() < 1e-9
    angles = (turns * TURN.inv()).as_rotvec()
    np.testing.assert_allclose(angles, np.outer(angles @ axis, axis), atol=1e-9)
    assert (np.diff(angles @ axis) > -1e-9).all()
    assert np.abs(omega).max() == pytest.approx(0.99 * TURNS.speed, rel=1e-6)  # of one component
    assert_bounded(turns)


def test_a_pose_goes_and_turns_at_the_same_time():
    target, aim = live(), Rotation.from_rotvec([0.0, 0.0, 0.4]) * TURN
    target.take(0.0, T, pose(aim, HOME[:3] + 0.2), NO_RATES, 0.001)
    places, turns, _ = motion(target, range(3000))
    shares = (places[:, 0] - HOME[0]) / 0.2
    np.testing.assert_allclose((turns * TURN.inv()).magnitude(), 0.4 * shares, atol=1e-9)
    place, speed = np.zeros((2, 6))
    for tick in range(1, 2999, 100):
        target.at(tick * T, place, speed)
        found = (places[tick + 1] - places[tick - 1]) / (2.0 * T)
        np.testing.assert_allclose(found, speed[:3], atol=BOUNDS.jerk * T * T)
    assert shares[-1] == pytest.approx(1.0, abs=1e-12)


def test_late_chunks_of_poses_lead_to_the_curve_without_lag_and_without_a_jump():
    target, place, speed = live(), *np.zeros((2, 6))
    path = []
    for tick in range(6000):
        if tick % 50 == 0 and tick >= 300:  # sent 300 ms ago, reaching 400 ms ahead
            first = tick - 300
            points = pose(turning((first + 50 * np.arange(15)) * T))
            assert target.take(first * T, 0.05, points, NO_RATES, (tick + 1) * T) == 7
        target.at(tick * T, place, speed)
        path.append(place.copy())
    turns = Rotation.from_rotvec(np.array(path)[:, 3:])
    away = (turns * turning(T * np.arange(6000)).inv()).magnitude()
    assert away[3000:].max() < 1e-5
    assert_bounded(turns)


def test_at_the_end_of_a_chunk_it_comes_to_rest():
    target = live()
    target.take(0.0, 0.05, pose(turning(0.05 * np.arange(21))), NO_RATES, 0.001)
    _, turns, omega = motion(target, range(3000))
    assert (turns[-500] * turns[-1].inv()).magnitude() < 1e-12
    assert np.abs(omega[-500:]).max() == 0.0
    assert (turns[-1] * turning(1.0)[0].inv()).magnitude() < 0.1


def test_a_stale_pose_is_held_or_left_for_home_or_stops():
    aim = Rotation.from_rotvec([0.0, 0.5, 0.0]) * TURN
    held, returning = live(stale_after_s=2.0), live(stale_after_s=2.0, when_stale="return")
    stopping = live(stale_after_s=2.0, when_stale="stop")
    for target in (held, returning, stopping):
        target.take(0.0, T, pose(aim, HOME[:3] + 0.1), NO_RATES, 0.001)
        assert target.stops_at_s == (2.001 if target is stopping else math.inf)
    (place,), (turn,), _ = motion(held, range(5000, 5001))
    np.testing.assert_allclose(place, HOME[:3] + 0.1, atol=1e-12)
    assert (turn * aim.inv()).magnitude() < 1e-12
    places, turns, _ = motion(returning, range(5000))
    assert (turns[2000] * aim.inv()).magnitude() < 1e-9
    assert (turns[-1] * TURN.inv()).magnitude() < 1e-12
    np.testing.assert_allclose(places[-1], HOME[:3], atol=1e-12)
    assert_bounded(turns)


UPRIGHT = pose(TURN)


@pytest.mark.parametrize(
    ("points", "rates", "reason"),
    [
        (UPRIGHT[:, :6], NO_RATES, "wrong_size"),
        (UPRIGHT, np.zeros((1, 7)), "wrong_size"),
        (UPRIGHT * np.nan, NO_RATES, "not_finite"),
        (UPRIGHT * [1, 1, 1, 1.002, 1.002, 1.002, 1.002], NO_RATES, "not_unit"),
        (UPRIGHT * [1, 1, 1, 0, 0, 0, 0], NO_RATES, "not_unit"),
        (UPRIGHT + np.eye(1, 7) * 3.0, NO_RATES, "out_of_range"),
        (pose(Rotation.from_rotvec([0.0, 0.51, 0.0]) * TURN), NO_RATES, "out_of_range"),
        (pose(turning(np.array([0.0, 0.6]))), NO_RATES, "too_fast"),
    ],
)
def test_what_cannot_be_followed_is_refused_and_nothing_moves(points, rates, reason):
    target = live(within_rad=0.5)
    target.take(0.0, T, pose(Rotation.from_rotvec([0.0, 0.4, 0.0]) * TURN), NO_RATES, 0.001)
    before = motion(target, range(2000))
    assert target.take(1.0, 0.05, points, rates, 1.0) == reason
    after = motion(target, range(2000))
    np.testing.assert_array_equal(before[0], after[0])
    np.testing.assert_array_equal(before[1].as_quat(), after[1].as_quat())


def test_the_range_of_orientations_is_about_a_given_one_or_that_of_the_begin():
    aside = Rotation.from_rotvec([0.0, 0.3, 0.0])
    for middle, around in ((TURN, None), (aside, aside.as_rotvec())):
        target = live(within_rad=0.2, around=around)
        for angle, taken in ((0.199, True), (0.201, False)):
            points = pose(Rotation.from_rotvec([angle, 0.0, 0.0]) * middle)
            assert isinstance(target.take(0.0, T, points, NO_RATES, 0.001), int) == taken


def test_nearly_unit_quaternions_are_made_unit():
    aim = Rotation.from_rotvec([0.0, 0.4, 0.0]) * TURN
    for factor in (0.9991, 1.0009):
        target, points = live(), pose(aim)
        points[:, 3:] *= factor
        assert target.take(0.0, T, points, NO_RATES, 0.001) == 0
        _, turns, _ = motion(target, range(4000, 4001))
        assert (turns[0] * aim.inv()).magnitude() < 1e-9


def test_an_orientation_alone_has_four_numbers_and_three_degrees_of_freedom():
    none, aim = np.zeros(0), Rotation.from_rotvec([0.2, 0.0, 0.0])
    target = Live("palm", "", (), none, none, turning=Turning(TURNS))
    assert (target.as_json()["dimension"], target.as_json()["rates"]) == (4, 3)
    target.start(np.zeros(3), 0.0)
    assert target.take(0.0, T, aim.as_quat()[None], np.zeros((0, 3)), 0.001) == 0
    place, speed = np.zeros((2, 3))
    target.at(3.0, place, speed)
    np.testing.assert_allclose(place, [0.2, 0.0, 0.0], atol=1e-9)
    assert not speed.any()
