"""Bounds of the acceleration: exact by brute force, decided where it is hard, refused if wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from viability import random_states

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.limits.viability_bounds import AccelerationBounds, acceleration_bounds

SEEDS = st.integers(0, 2**32 - 1)
LIMITS = (-2.0, 2.0, 2.0, 12.0)
T = 0.01


@settings(max_examples=20)
@given(seed=SEEDS)
def test_held_for_any_time_up_to_the_horizon_the_joint_keeps_its_limits(seed):
    """With random choices between the bounds, and missed ticks."""
    rng = np.random.default_rng(seed)
    states = random_states(rng, 40, 0.02)
    bounds = AccelerationBounds(*states.limits, 0.005, horizon_s=0.02)
    q, v = states.q.copy(), states.v.copy()
    least, most = np.empty(40), np.empty(40)
    slack = 1e-12 * np.maximum(1.0, states.upper - states.lower)
    for _ in range(200):
        bounds.solve(q, v, least, most)
        pick = rng.choice([0.0, 1.0, rng.random()])
        a, held = least + pick * (most - least), rng.choice([0.005, 0.01, 0.015, 0.02])
        for part in np.linspace(0.0, held, 6)[1:]:
            along = q + part * (v + 0.5 * part * a)
            assert np.all(along <= states.upper + slack)
            assert np.all(along >= states.lower - slack)
        q, v = q + held * (v + 0.5 * held * a), v + held * a
        assert np.all(np.abs(v) <= states.speed * (1 + 1e-12))


@pytest.mark.parametrize(
    ("q", "v", "expected"),
    [
        (2.0, 0.0, (-12.0, 0.0)),
        (-2.0, 0.0, (0.0, 12.0)),
        (2.0, 0.5, (-12.0, -12.0)),
        (1.99, 1.9, (-12.0, -12.0)),
        (0.0, 4.0, (-12.0, -12.0)),
        (0.0, 2.1, (-12.0, -10.0)),
        (2.1, 0.0, (-12.0, -12.0)),
        (2.1, -1.0, (-12.0, -12.0)),
        (2.1, -2.0, (0.0, 0.0)),
        (-2.1, 0.0, (12.0, 12.0)),
        (-2.1, 2.0, (0.0, 0.0)),
        (0.0, 0.0, (-12.0, 12.0)),
    ],
)
def test_hard_states_are_decided(q, v, expected):
    least, most = acceleration_bounds(q, v, *LIMITS, T)
    np.testing.assert_allclose((least[0], most[0]), expected, rtol=0, atol=1e-11)
    assert least[0] <= most[0]


@pytest.mark.parametrize("ulps", [1, 8])
def test_rounding_outside_does_not_kick_a_joint_that_rests(ulps):
    q = 2.0 + ulps * np.spacing(2.0)
    least, most = acceleration_bounds(q, 0.0, *LIMITS, T)
    assert -1e-10 < most[0] <= 0.0
    assert least[0] == -12.0


def test_without_limits_all_the_joint_has_is_allowed():
    inf = np.inf
    least, most = acceleration_bounds([0.0, 1e9], [1.0, -5.0], -inf, inf, inf, 3.0, T)
    np.testing.assert_array_equal(least, -3.0)
    np.testing.assert_array_equal(most, 3.0)
    least, most = acceleration_bounds(0.0, 1.0, -inf, 0.17, inf, 3.0, T)
    assert (least[0], -3.0 <= most[0] < 0.0) == (-3.0, True)
    least, most = acceleration_bounds(0.0, 0.0, -inf, inf, inf, inf, T)
    assert (least[0], most[0]) == (-inf, inf)


def least_gap(span, speed, A=12.0):
    """Upper less lower bound, each computed for its side alone, where a joint can just stop."""
    inf, room = np.inf, np.geomspace(1e-12, 1.0, 2000) * min(span, 1.0)
    v = np.minimum(np.sqrt(2.0 * A * room), speed)
    most = acceleration_bounds(-room, v, -inf, 0.0, inf, A, T)[1]
    least = acceleration_bounds(-room, v, -span, inf, inf, A, T)[0]
    return (most - np.maximum(least, (-speed - v) / T)).min() / A


def test_condition_11_is_what_keeps_the_bounds_apart():
    """At equality no state has crossing bounds, just beyond it some do."""
    A, far = 12.0, 1e3
    assert least_gap(A * T**2, far) >= -1e-9
    assert least_gap(0.97 * A * T**2, far) < -1e-3
    assert least_gap(far, A * T) >= -1e-9
    assert least_gap(far, 0.97 * A * T) < -1e-3


@settings(max_examples=50)
@given(seed=SEEDS)
def test_shrinking_gives_just_what_condition_11_asks_for(seed):
    rng = np.random.default_rng(seed)
    n = 200
    span, speed = 10.0 ** rng.uniform(-2, 1, n), 10.0 ** rng.uniform(-1, 1, n)
    up, down = 10.0 ** rng.uniform(0, 8, n), 10.0 ** rng.uniform(0, 8, n)
    bounds = AccelerationBounds(-span, 0.0, speed, up, T, deceleration=down, shrink=True)
    assert np.all(bounds.up <= up)
    assert np.all(bounds.down <= down)
    fast, slow = np.maximum(bounds.up, bounds.down), np.minimum(bounds.up, bounds.down)
    assert np.all(speed >= T * fast * (1 - 1e-9))
    assert np.all(span >= 0.5 * T**2 * fast * (1 + fast / slow) * (1 - 1e-9))
    satisfied = (speed >= T * np.maximum(up, down)) & (
        span
        >= 0.5 * T**2 * np.maximum(up, down) * (1 + np.maximum(up, down) / np.minimum(up, down))
    )
    np.testing.assert_array_equal(bounds.up[satisfied], up[satisfied])
    np.testing.assert_array_equal(bounds.down[satisfied], down[satisfied])


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"lower": 3.0}, "joint 0.* 3 "),
        ({"lower": np.nan}, "nan"),
        ({"velocity": 0.0}, "speed 0"),
        ({"acceleration": -1.0}, "acceleration -1"),
        ({"acceleration": 300.0}, r"\(11\).*speed 2"),
        ({"acceleration": np.inf}, r"\(11\).*speed 2"),
        ({"upper": -1.999, "velocity": 20.0, "acceleration": 100.0}, r"\(11\).*range 0\.001"),
        ({"period_s": 0.0}, "period 0.0"),
        ({"horizon_s": 0.001}, "horizon"),
        ({"lower": "low"}, ""),
        *(({"brake_share": value}, "share") for value in (0.0, -0.1, 1.1, np.nan)),
        *(({"softness": value}, "softness") for value in (-1e-9, np.inf, np.nan)),
    ],
)
def test_limits_that_cannot_be_kept_are_named(changed, named):
    given = {
        "lower": -2.0, "upper": 2.0, "velocity": 2.0, "acceleration": 12.0, "period_s": T, **changed
    }  # fmt: skip
    with pytest.raises(BadProblemError, match=named or None):
        AccelerationBounds(**given)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["q", "dq"])
def test_what_is_not_finite_is_an_error_and_never_a_number(place, value):
    bounds = AccelerationBounds(*LIMITS, T, names=["elbow"])
    state = {"q": np.zeros(1), "dq": np.zeros(1), place: np.full(1, value)}
    least, most = np.full(1, 7.0), np.full(1, 8.0)
    with pytest.raises(BadProblemError, match="joint elbow"):
        bounds.solve(state["q"], state["dq"], least, most)
    assert (least[0], most[0]) == (7.0, 8.0)


@pytest.mark.parametrize("q", [np.zeros(2), [0.0], np.zeros(1, np.float32)])
def test_wrong_arrays_are_refused(q):
    bounds = AccelerationBounds(*LIMITS, T)
    with pytest.raises(BadProblemError, match="float64"):
        bounds.solve(q, np.zeros(1), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize(
    ("part", "given"),
    [
        ("velocity", {"velocity": 12.0 * T}),
        ("velocity", {"velocity": 12.0 * 3 * T, "horizon_s": 3 * T}),
        ("upper", {"upper": 12.0 * T**2}),
        ("upper", {"upper": 0.5 * 12.0 * T**2 * (1 + 12 / 6), "deceleration": 6.0}),
        ("upper", {"upper": 0.5 * 12.0 * T**2 * (1 + 12 / 3), "brake_share": 0.25}),
    ],
)
def test_condition_11_is_kept_at_equality_and_refused_just_beyond(part, given):
    limits = {"lower": 0.0, "upper": 4.0, "velocity": 2.0, "acceleration": 12.0, "period_s": T}
    AccelerationBounds(**{**limits, **given})
    with pytest.raises(BadProblemError, match=r"\(11\)"):
        AccelerationBounds(**{**limits, **given, part: 0.999 * given[part]})
    shrunk = AccelerationBounds(**{**limits, **given, part: 0.9 * given[part]}, shrink=True)
    assert max(shrunk.up[0], shrunk.down[0]) < 12.0


@pytest.mark.parametrize("q", [[0.0, 0.0], "low"])
def test_states_and_limits_that_do_not_fit_are_refused(q):
    with pytest.raises(BadProblemError):
        acceleration_bounds(q, 0.0, [-1.0] * 3, [1.0] * 3, 2.0, 12.0, T)


@pytest.mark.parametrize("T", [0.2, 1.0])
def test_the_naive_bounds_need_no_condition_11(T):
    """As in Fig. 4, where 20 periods violate it; at 1 s the bounds of both walls cross."""
    with pytest.raises(BadProblemError, match=r"\(11\)"):
        acceleration_bounds(0.0, 0.0, *LIMITS, T)
    bounds = AccelerationBounds(np.full(3, -2.0), *LIMITS[1:], T, naive=True)
    least, most = np.empty((2, 3))
    bounds.solve_naive(np.array([1.9, -1.9, 0.0]), np.array([1.0, -2.0, 0.0]), least, most)
    a = 12.0
    for joint, (q, v) in enumerate([(1.9, 1.0), (-1.9, -2.0), (0.0, 0.0)]):
        top = np.clip(min((2.0 - v) / T, 2.0 * (2.0 - q - T * v) / T**2), -a, a)
        low = np.clip(max((-2.0 - v) / T, 2.0 * (-2.0 - q - T * v) / T**2), -a, a)
        assert (least[joint], most[joint]) == pytest.approx((min(low, top), top))


def test_naive_bounds_answer_by_2_only():
    bounds = AccelerationBounds(*LIMITS, 0.2, naive=True)
    with pytest.raises(BadProblemError, match="solve_naive"):
        bounds.solve(*np.zeros((4, 1)))
    with pytest.raises(BadProblemError, match="1 to -1"):
        AccelerationBounds(1.0, -1.0, 2.0, 12.0, T, naive=True)


def excess_where_braking_is_weak(brake_share):
    """How far joints get out that brake 8 % too weakly, and speed up 8 % too strongly."""
    rng, n, T = np.random.default_rng(0), 500, 0.001
    bounds = AccelerationBounds(
        np.full(n, -1.0), 1.0, 2.0, 20.0, T, horizon_s=2 * T, brake_share=brake_share
    )
    q, v = rng.uniform(-0.5, 0.5, n), np.zeros(n)
    least, most = np.empty(n), np.empty(n)
    towards, excess = rng.choice([-1.0, 1.0], n), 0.0
    for _ in range(1500):
        bounds.solve(q, v, least, most)
        assert np.all(least <= most)
        wanted = np.where(towards > 0.0, most, least)
        done = wanted * np.where(wanted * v < 0.0, 0.92, 1.08)
        q += T * v + 0.5 * T**2 * done
        v += T * done
        excess = max(excess, np.abs(q).max() - 1.0)
    return excess


def test_a_share_of_the_braking_leaves_room_for_accelerations_that_are_not_quite_met():
    assert excess_where_braking_is_weak(0.9) < 1e-4  # what one step may add at the wall
    assert excess_where_braking_is_weak(1.0) > 1e-3


def test_counting_on_less_braking_asks_for_it_earlier():
    """At 1 rad/s and 40 mrad from the limit, 12.5 rad/s² is needed: within 20, but not 10."""
    limits = ([0.46], [1.0], -0.5, 0.5, 2.0, 20.0, 0.001)
    assert acceleration_bounds(*limits)[1][0] > 0.0
    state = np.array([0.46]), np.array([1.0])
    careful = AccelerationBounds(-0.5, 0.5, 2.0, [20.0], 0.001, brake_share=0.5)
    least, most = np.empty(1), np.empty(1)
    careful.solve(*state, least, most)
    assert least[0] == most[0] == -20.0  # too fast for 10, so all that there is


def test_softness_draws_a_joint_back_gently_that_came_out_a_little():
    """Out by 3 nrad, and still on the way out by 1 nrad/s."""
    exact = AccelerationBounds(-1.0, 1.0, 2.0, [20.0], 0.001)
    soft = AccelerationBounds(-1.0, 1.0, 2.0, [20.0], 0.001, softness=1e-6)
    least, most, v = np.empty(1), np.empty(1), np.array([1e-9])
    for q, bounds, expected in (
        (1.0 + 3e-9, exact, -20.0),
        (1.0 + 3e-9, soft, -2.0 * 3e-9 / 0.001**2),
        (1.0 + 1.1e-6, soft, -20.0),
    ):
        bounds.solve(np.array([q]), v, least, most)
        assert most[0] == pytest.approx(expected, rel=1e-3)
        bounds.solve(np.array([-q]), -v, least, most)
        assert least[0] == pytest.approx(-expected, rel=1e-3)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_with_softness_a_joint_goes_out_by_no_more_than_that(seed):
    """Under noise of each acceleration, at the wall as everywhere; and it does not hammer there."""
    rng, n, T, softness = np.random.default_rng(seed), 30, 0.001, 1e-6
    bounds = AccelerationBounds(
        np.full(n, -1.0), 1.0, 2.0, 20.0, T, horizon_s=2 * T, brake_share=0.9, softness=softness
    )
    q, v = rng.uniform(-0.9, 0.9, n), np.zeros(n)
    least, most = np.empty(n), np.empty(n)
    hardest = 0.0
    for tick in range(3000):
        bounds.solve(q, v, least, most)
        assert np.all(least <= most)
        if tick > 2500:  # all are at the wall
            hardest = max(hardest, np.abs(most).max())
        done = most + rng.uniform(-0.1, 0.1, n)
        q += T * v + 0.5 * T**2 * done
        v += T * done
    assert np.abs(q).max() <= 1.0 + softness
    assert q.min() > 1.0 - 1e-4
    assert hardest < 2.0
