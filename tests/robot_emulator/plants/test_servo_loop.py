"""How fast a loop around servos may be, beside the roots of that loop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from hoap3.robot_emulator.plants.mujoco.gains import CLOSE, rate_limit

Array = NDArray[np.float64]


def worst_root(mass: Array, kp: Array, kv: Array, B: Array) -> float:
    """Greatest real part of the roots of q̇* = −B·q around servos, beside their size."""
    n = len(kp)
    zero, one, inverse = np.zeros((n, n)), np.eye(n), np.linalg.inv(mass)
    stiff, damped = inverse * kp, inverse * kv
    loop = np.block([[zero, one, zero], [-stiff, -damped, stiff], [-B, zero, zero]])
    roots = np.linalg.eigvals(loop)
    return float(roots.real.max() / np.abs(roots).max())


def robots(rng: np.random.Generator, count: int) -> Iterator[tuple[Array, Array, Array]]:
    """M, kp and kv of robots whose joints differ by up to a factor of 1,000."""
    for _ in range(count):
        n = int(rng.integers(2, 7))
        root = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-1.0, 0.5, (n, 1))
        kp = 10.0 ** rng.uniform(0.0, 3.0, n)
        yield root @ root.T + 1e-3 * np.eye(n), kp, kp * 10.0 ** rng.uniform(-2.0, -1.0, n)


def laws(rng: np.random.Generator, n: int, count: int) -> Iterator[Array]:
    """Symmetric B of every rank, whose greatest eigenvalue is 1."""
    for _ in range(count):
        wide = rng.normal(size=(n, int(rng.integers(1, n + 1))))
        B = wide @ wide.T
        yield B / np.linalg.eigvalsh(B)[-1]


def test_every_loop_below_the_limit_is_stable_whatever_the_gains():
    rng = np.random.default_rng(8)
    for mass, kp, kv in robots(rng, 40):
        for gains in ((kp, kv), (kp, 0.02 * kp), (np.full_like(kp, kp[0]), kv)):
            limit = rate_limit(mass, *gains)
            for B in laws(rng, len(kp), 40):
                assert worst_root(mass, *gains, 0.999 * limit * B) < 1e-9


def test_with_the_same_gains_nothing_faster_is_stable():
    rng = np.random.default_rng(3)
    for mass, kp, kv in robots(rng, 20):
        same = np.full_like(kp, kp[0]), np.full_like(kv, kv[0])
        limit = rate_limit(mass, *same)
        assert limit == pytest.approx(kv[0] / np.linalg.eigvalsh(mass)[-1])
        assert worst_root(mass, *same, 1.001 * limit * np.eye(len(kp))) > 0.0
        nearly = same[0] * (1.0 + 1e-9 * np.arange(len(kp)))  # by the bound for gains that differ
        assert rate_limit(mass, nearly, same[1]) == pytest.approx(limit, rel=2.0 * CLOSE)


def test_the_worst_law_beyond_a_limit_is_unstable():
    """Two joints on one inertia, stiff and soft."""
    mass, kp = np.array([[1.0, 0.3], [0.3, 1.0]]), np.array([10.0, 1000.0])
    kv = 0.02 * kp
    limit = rate_limit(mass, kp, kv)
    angles = np.linspace(0.0, np.pi, 181)
    axes = [np.outer(x, x) for x in np.stack([np.cos(angles), np.sin(angles)], axis=1)]
    for share, stable in ((0.999, True), (1.2, False)):
        roots = [worst_root(mass, kp, kv, share * limit * B) for B in axes]
        assert (max(roots) < 1e-9) == stable
