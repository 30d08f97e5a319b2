"""Random hierarchies of tasks with bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST = -np.inf


@dataclass
class Hierarchy:
    """One problem, by the names of `ghc`."""

    jacobians: list[np.ndarray]
    targets: list[np.ndarray]
    alpha: np.ndarray
    M: np.ndarray
    bias: np.ndarray
    w_r: float
    regularise: str
    bounds: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

    @property
    def arguments(self) -> tuple:
        return (self.jacobians, self.targets, self.alpha, self.M, self.bias, self.w_r)

    @property
    def options(self) -> dict:
        names = ("qdd_lower", "qdd_upper", "tau_lower", "tau_upper")
        return {"regularise": self.regularise, **dict(zip(names, self.bounds, strict=True))}


def hierarchy(seed: int, n: int | None = None, k: int | None = None) -> Hierarchy:
    """Duplicate and zero rows, ties, cycles; some span all joints; free to tightly bounded."""
    rng = np.random.default_rng(seed)
    n, k = n or int(rng.integers(1, 8)), k or int(rng.integers(1, 6))
    jacobians = [rng.normal(size=(rng.integers(1, 5), n)) for _ in range(k)]
    if rng.random() < 0.7:
        jacobians[-1] = np.eye(n)
    if k > 2 and rng.random() < 0.3:
        jacobians[1] = jacobians[0].copy()
    if rng.random() < 0.2:
        jacobians[0][0] = 0
    alpha = rng.choice([0, 0, 1, 1, 0.5, rng.random()], size=(k, k))
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    tight = rng.choice([0.3, 1, 5, np.inf])
    reach = np.concatenate([np.full(2 * n, tight), np.full(2 * n, 5 * tight)])
    sizes = np.where(reach < np.inf, reach * rng.uniform(0.1, 1, size=4 * n), np.inf)
    absent = rng.random(4 * n) < 0.1
    sizes[absent] = np.inf
    return Hierarchy(
        jacobians,
        [5 * rng.normal(size=len(J)) for J in jacobians],
        alpha,
        root @ root.T + 0.1 * np.eye(n),
        3 * rng.normal(size=n),
        10 ** rng.uniform(-4, -1),
        str(rng.choice(["none", "torque", "gravity_compensated"])),
        (-sizes[:n], sizes[n : 2 * n], -sizes[2 * n : 3 * n], sizes[3 * n :]),
    )
