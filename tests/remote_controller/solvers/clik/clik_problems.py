"""Stacks of tasks: regular, apart, nearly dependent, dependent, too many for their joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KINDS = ("regular", "apart", "near", "dependent", "many")


@dataclass
class Stack:
    """What a solver of prioritised tasks is given; limits of dq hold lower ≤ 0 ≤ upper."""

    sizes: tuple[int, ...]
    J: np.ndarray
    errors: np.ndarray
    weights: np.ndarray
    rates: np.ndarray
    wanted: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    dt: float
    damping: float

    @property
    def offsets(self) -> np.ndarray:
        return np.concatenate([[0], np.cumsum(self.sizes)]).astype(np.int64)

    @property
    def condition(self) -> float:
        """κ, the worst of all that is inverted: each [J_i | dI], and what stands above each."""
        ends, worst = np.cumsum(self.sizes), 1.0
        parts = [self.J[:end] for end in ends[:-1]]
        for d, end in zip(self.sizes, ends, strict=True):
            parts.append(np.hstack([self.J[end - d : end], self.damping * np.eye(d)]))
        for part in parts:
            values = np.linalg.svd(part, compute_uv=False)
            kept = values[values > 1e-9 * values[0]]
            worst = max(worst, kept[0] / kept[-1]) if kept.size else worst
        return worst


def stack(seed: int) -> Stack:
    """A random one; the kinds take turns, with and without damping, weights and limits."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    sizes = tuple(int(d) for d in rng.integers(1, 4, size=rng.integers(1, 5)))
    n = sum(sizes)
    joints = max(1, n - int(rng.integers(1, 4))) if kind == "many" else n + int(rng.integers(0, 8))
    J = rng.normal(size=(n, joints))
    if kind == "apart":
        J = np.kron(np.eye(len(sizes)), np.ones((3, 3)))
        rows = np.concatenate([np.arange(3 * i, 3 * i + d) for i, d in enumerate(sizes)])
        J = J[rows] * rng.normal(size=(n, 3 * len(sizes)))
        joints = J.shape[1]
    if kind == "near":
        J[-1] = J[0] + 10 ** rng.uniform(-4, -1) * rng.normal(size=joints)
    if kind == "dependent":
        J[-1] = rng.normal(size=n - 1) @ J[:-1] if seed % 2 else 0.0
    reach = 10 ** rng.uniform(-0.5, 1.5)
    lower, upper = -reach * rng.uniform(0.1, 1, joints), reach * rng.uniform(0.1, 1, joints)
    if rng.random() < 0.3:
        lower[:], upper[:] = -np.inf, np.inf
    return Stack(
        sizes,
        J,
        rng.normal(size=n) * 10 ** rng.uniform(-2, 0),
        10.0 ** rng.uniform(-4, 2, n) if rng.random() < 0.5 else np.ones(n),
        rng.normal(size=n) * 10 ** rng.uniform(-2, 1) * (rng.random() < 0.5),
        rng.uniform(0.1, 20.0, n),
        lower,
        upper,
        float(10 ** rng.uniform(-3, -1.3)),
        float(rng.choice([1e-3, 0.1, 3.0])) if rng.random() < 0.3 else 0.0,
    )
