"""Task-space inverse dynamics against the plain reference: (33), (34)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from support.amounts import seed_ranges
from support.oracles import tsid_oracle as reference
from tsid_problems import with_rows

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.tasks.accelerations.se3_pd_kernels import (
    Asked,
    Motion,
    Pose,
    se3_pd,
)

SEEDS = seed_ranges(200, 1000, 5200)


@pytest.mark.parametrize("seeds", SEEDS)
def test_33(seeds):
    """ddq to 1e-10 of its largest value where κ(H) ≤ 1e5, to κ·1e-15 beyond that."""
    solved = 0
    for seed in seeds:
        it = with_rows(seed, [1, 3, 7, 12][seed % 4], [3.0, 6.0][seed % 2])
        found, solver = it.solve()
        H, _ = it.cost
        bounds, rows = (it.lower, it.upper), (it.R, it.least, it.most)
        expected = reference.tsid(it.J, it.y, it.w, it.p, it.M, it.h, bounds, it.effort, rows)
        assert (found == status.OK) == (expected is not None)
        if expected is None:
            continue
        solved += 1
        ddq, tau = expected
        rounding = max(1e-10, 1e-15 * np.linalg.cond(H)) * max(1.0, np.abs(ddq).max())
        np.testing.assert_allclose(solver.ddq, ddq, rtol=0, atol=rounding)
        reach = rounding * np.abs(it.M).sum(axis=1).max()
        np.testing.assert_allclose(solver.tau, tau, rtol=0, atol=reach)
    assert solved > len(seeds) // 4


def pose(twist: np.ndarray) -> np.ndarray:
    """exp of a twist (v, ω)."""
    v, (x, y, z) = twist[:3], twist[3:]
    xi = np.zeros((4, 4))
    xi[:3, :3], xi[:3, 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]], v
    return expm(xi)


@pytest.mark.parametrize("seeds", SEEDS)
def test_34(seeds):
    """Up to 3 rad from the goal, to 1e-10: at half a turn the logarithm has two values."""
    turn, error, wanted, slope = np.zeros((3, 3)), *np.zeros((3, 6))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        apart = rng.normal(size=6)
        apart[3:] *= rng.uniform(0.0, 3.0) / np.linalg.norm(apart[3:])
        H = pose(rng.normal(size=6))
        goal, twist, drift = H @ pose(apart), rng.normal(size=6), rng.normal(size=6)
        kp, kd = rng.exponential(size=2)
        arrays = [np.ascontiguousarray(each) for each in (H[:3, 3], goal[:3, 3], goal[:3, :3])]
        origin, goal_origin, goal_rotation = arrays
        se3_pd(
            Pose(origin, np.ascontiguousarray(H[:3, :3])),
            Pose(goal_origin, goal_rotation),
            *(Motion(twist, drift), kp, kd, turn, Asked(error, wanted, slope)),
        )
        expected, acceleration = reference.desired_acceleration(H, goal, twist, kp, kd)
        np.testing.assert_allclose(error, expected, rtol=0, atol=1e-10)
        np.testing.assert_allclose(error, apart, rtol=0, atol=1e-10)
        np.testing.assert_allclose(wanted, acceleration - drift, rtol=0, atol=1e-9)
