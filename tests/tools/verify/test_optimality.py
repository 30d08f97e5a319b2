"""Multipliers that prove an optimum of (3) are found however slowly the robot moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.oracles.stable_qp_arrays.optimality import residual
from support.oracles.stable_qp_arrays.scaled import Scaled

N, EQUATIONS, KAPPA = 21, 6, 0.1
CREEP = 1e-14  # rad/s


def optimum(seed: int, speed: float) -> Scaled:
    """A problem made around its optimum, y = sign(r)·max(0, |r| − κ) with r = Cᵀz + z₀·s.

    Joints that should stand still creep by what a solver's rounding leaves.
    """
    rng = np.random.default_rng(seed)
    C = rng.normal(size=(EQUATIONS, N))
    C /= np.linalg.norm(C, axis=1)[:, None]
    slope = rng.normal(size=N)
    slope /= np.abs(slope).max()
    r = speed * rng.normal(size=EQUATIONS + 1) @ np.vstack([C, slope])
    kappa = KAPPA * speed
    y = np.sign(r) * np.maximum(np.abs(r) - kappa, 0.0)
    y[y == 0.0] = CREEP * rng.normal(size=np.count_nonzero(y == 0.0))
    none, bound = np.zeros((0, N)), np.full(N, 0.6)
    return Scaled(
        y=y,
        doubt=np.zeros(N),
        lower=-bound,
        upper=bound,
        kappa=kappa,
        top=1.0,
        slope=slope,
        slope_doubt=np.zeros(N),
        rows=none,
        sides=np.zeros(0),
        asked=np.zeros(0, np.bool_),
        equations=C,
        values=C @ y,
        H=np.eye(N),
        f=np.zeros(N),
        wanted=-float(slope @ y),
        scale=max(float(np.abs(y).max()), 6e-4),
    )


@pytest.mark.parametrize("speed", [1e-12, 1e-11, 1e-9, 1e-6, 0.1])
def test_an_optimum_is_proved_at_any_speed(speed: float) -> None:
    assert max(residual(optimum(seed, speed), "norm", 1e-9) for seed in range(100)) <= 1e-9


@given(seed=st.integers(0, 2**32 - 1), exponent=st.floats(-3.0, -1.0))
def test_what_is_no_optimum_is_not_proved(seed: int, exponent: float) -> None:
    p = optimum(seed, 10.0**exponent)
    p.y[np.argmax(np.abs(p.y))] *= 1.0 + 1e-4
    p.values[:] = p.equations @ p.y
    assert residual(p, "norm", 1e-9) > 1e-9
