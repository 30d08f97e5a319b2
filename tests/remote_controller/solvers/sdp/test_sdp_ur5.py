"""The run of the paper's section V: V, β, gains and speeds, to the digits of its reproduction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ur5_dh import constant, simulate

TABLE = [
    # β̃, Δt, limit; V(.1), V(.5), V(1), V(2), V(3); β(0), β(.2), β(1), β(3); steps at the limit
    (2.0, 0.01, 6.0, (".354", "9.0e-2", "2.1e-2", "9.4e-4", "8.0e-5"), "1.74 1.91 1.89 1.12", 0),
    (8.0, 0.01, 6.0, (".232", "2.5e-3", "2.3e-5", "2.4e-7", "6.5e-9"), "6.74 7.71 3.52 1.98", 21),
    (8.0, 0.01, 4.0, (".288", "9.2e-3", "5.0e-5", "4.2e-7", "1.3e-8"), "4.65 4.64 3.79 1.90", 36),
    (8.0, 0.1, 6.0, (".264", "4.5e-3", "", "", "2e-10"), "5.07", None),
    (8.0, 0.05, 6.0, (".239", "3.0e-3", "", "", "1e-9"), "6.26", None),
    (8.0, 0.005, 6.0, (".231", "2.4e-3", "", "", "7e-9"), "6.80", None),
]


def like(printed: str, value: float) -> bool:
    """Whether the value is what is printed, rounded to as many digits."""
    mantissa, _, exponent = printed.partition("e")
    digits = len(mantissa.partition(".")[2])
    last = 10.0 ** (int(exponent or 0) - digits)
    return abs(value - float(printed)) <= 0.51 * last


@pytest.mark.parametrize(("desired", "dt", "limit", "V", "beta", "held"), TABLE)
def test_the_run(desired, dt, limit, V, beta, held):
    run = simulate(desired, dt, limit)
    assert like("0.4558", run.V[0])
    for time, printed in zip((0.1, 0.5, 1.0, 2.0, 3.0), V, strict=True):
        assert not printed or like(printed, run.V[round(time / dt)]), (time, printed)
    for time, printed in zip((0.0, 0.2, 1.0, 3.0), beta.split(), strict=False):
        assert like(printed, run.beta[round(time / dt)]), (time, printed)
    assert all(after < before for before, after in zip(run.V, run.V[1:], strict=False))
    speeds = np.abs(run.dq)
    assert speeds.max() <= limit
    if held is not None:
        assert np.count_nonzero((speeds > limit - 1e-6).any(axis=1)) == held


def test_with_constant_gains_the_second_error_stays():
    run = constant(np.array([2.0, 2.0, 2.0, 1.0]))
    for time, printed in zip((0.1, 0.5, 1.0, 2.0, 3.0), TEXT, strict=True):
        assert like(printed, run.V[round(time / 0.01)])
    assert like("-0.59", min(run.beta))
    assert like("-0.43", max(run.beta))
    assert like("3.68", np.abs(run.dq).max())
    slower = simulate(2.0)
    assert slower.V[150] > run.V[150]
    assert slower.V[200] < run.V[200]


TEXT = (".305", "6.05e-2", "9.1e-3", "2.03e-3", "1.96e-3")


def test_the_gain_of_the_second_task_falls_and_rises_towards_the_singularity():
    """First, least, largest, last: read off at a coarse grid of times, hence within 2 %."""
    for desired, printed in ((8.0, (378, 204, 557, 484)), (2.0, (95, 50, 140))):
        gain = [gains[3] for gains in simulate(desired).gains]
        low = int(np.argmin(gain[:150]))
        found = (gain[0], gain[low], max(gain[low:]), gain[-1])
        assert np.allclose(found[: len(printed)], printed, rtol=0.02), found


def test_the_first_gain_converges_as_the_period_falls():
    found = [simulate(8.0, dt, seconds=0.6).gains[round(0.5 / dt)][0] for dt in (0.1, 0.05, 0.01)]
    assert [f"{gain:.2f}" for gain in found] == ["5.57", "5.47", "6.44"]


@pytest.mark.parametrize(("dt", "first"), [(0.1, "4.20"), (0.05, "5.85"), (0.01, None)])
def test_the_real_rate_is_below_the_certified_one_for_long_periods_only(dt, first):
    """The certificate is that of the linear model: Euler's steps of 0.05 s and more leave it."""
    run = simulate(8.0, dt)
    behind = [actual < beta for actual, beta in zip(run.actual, run.beta, strict=False)]
    if first is None:
        assert not any(behind)
    else:
        assert like(first, run.actual[0])
        assert behind[0]
        assert 1 <= sum(behind) <= 4


def test_newton_from_the_last_answer_suffices_nearly_always():
    run = simulate(8.0, 0.001, seconds=1.0)
    assert run.paths[0] == 2
    assert np.mean(np.array(run.paths) == 1) > 0.99
    assert max(map(abs, run.slack)) < 1e-10
    assert math.sqrt(max(run.gap)) < 1e-4
