"""The run of the paper's section V: V, β, gains and speeds, to the digits of its reproduction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ur5_dh import simulate

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


def test_newton_from_the_last_answer_suffices_nearly_always():
    run = simulate(8.0, 0.001, seconds=1.0)
    assert run.paths[0] == 2
    assert np.mean(np.array(run.paths) == 1) > 0.99
    assert max(map(abs, run.slack)) < 1e-10
    assert math.sqrt(max(run.gap)) < 1e-4
