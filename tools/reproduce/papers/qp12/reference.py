"""The laws and readings of the QP12 paper, and what its sections III and Example 2 give by hand.

`oracle` computes the motions of section V independently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CASES = {
    "A": {"psi_scale": "inverse_sqrt_n"},
    "B": {"psi_scale": "inverse_sqrt_n", "error_unit": "cm"},
    "C": {"psi_scale": "one"},
}
"""Readings of (16): A as printed with e in metres, B as printed with e in centimetres, and C in
metres without 1/√n. The paper prints no unit of e."""


@dataclass(frozen=True)
class Law:
    """How u is chosen: QP12 with γ, or the pseudo-inverse where `gamma` is None.

    Attributes:
        gamma: γ, or γ_far where adaptive.
        adaptive: γ = (2γ_far/π)·atan(100|∇V|), as in the paper's figures.
    """

    gamma: float | None
    adaptive: bool = True

    def __str__(self) -> str:
        if self.gamma is None:
            return "PINV"
        kind = "" if self.gamma == 0.0 else ", adaptive" if self.adaptive else ", constant"
        return f"γ = {self.gamma:g}{kind}"


PINV, EVEN, SPARSE = Law(None), Law(0.0), Law(0.99)
SPARSE_CONSTANT = Law(0.99, adaptive=False)
TRIALS = tuple(Law(gamma) for gamma in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99))
"""The 11 trials of section V-C."""

LAWS = (PINV, *TRIALS, Law(0.1, adaptive=False), SPARSE_CONSTANT)
"""Those that are done in every case."""

ANKLE = ("r_ankle_pitch", "r_ankle_roll")
"""The joints that the paper names for γ = 0.99."""

SWEEPS = 400  # over all pairs of joints, at most
EXACT = 1e-6  # relative: how well a descent finds a norm
SECTIONS = 60  # by the golden ratio


def norm(u: Array, p: float) -> float:
    """|u|_p, whatever p > 0."""
    size = float(np.abs(u).max())
    if math.isinf(p) or size == 0.0:
        return size
    return float(size * (np.abs(u / size) ** p).sum() ** (1.0 / p))


def least(gradient: Array, decrease: float, p: float) -> float:
    """The least |u|_p with gradient·u = −decrease, without formula (9)."""
    if math.isinf(p):
        return decrease / float(np.abs(gradient).sum())
    a = gradient[gradient != 0.0]
    if p <= 1.0:
        return decrease / float(np.abs(a).max())
    u = np.zeros_like(a)
    first = int(np.abs(a).argmax())
    u[first] = -decrease / a[first]
    for _ in range(SWEEPS):
        before = norm(u, p)
        for i in range(len(a)):
            for j in range(i):
                _exchange(u, a, i, j, p)
        if before - norm(u, p) <= 1e-3 * EXACT * before:
            break
    return norm(u, p)


def _exchange(u: Array, a: Array, i: int, j: int, p: float) -> None:
    """Give one joint's share to another as far as |u_i|^p + |u_j|^p falls, by golden section.

    Along (a_j, −a_i), which leaves a·u as it is, the sum is convex, and least somewhere between
    the places where either joint stands still.
    """
    x, y, slope_x, slope_y = float(u[i]), float(u[j]), float(a[j]), -float(a[i])
    low, high = sorted((-x / slope_x, -y / slope_y))

    def cost(step: float) -> float:
        return float(abs(x + step * slope_x) ** p + abs(y + step * slope_y) ** p)

    golden = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(SECTIONS):
        left, right = high - golden * (high - low), low + golden * (high - low)
        if cost(left) <= cost(right):
            high = right
        else:
            low = left
    step = 0.5 * (low + high)
    u[i], u[j] = x + step * slope_x, y + step * slope_y


def cut_polygon(corners: Array, gradient: Array, decrease: float, along: Array) -> Array:
    """Fig. 1: where the line gradient·u = −decrease cuts a polygon.

    Args:
        corners: of the polygon in order, (k, 2).
        gradient: (2,).
        decrease: how far V is to fall.
        along: unit vector along the line, (2,).

    Returns:
        The two ends, (2, 2), or (0, 2) where the line misses it.
    """
    levels = corners @ gradient + decrease
    levels[np.abs(levels) < 1e-12] = 0.0
    found = [corner for corner, level in zip(corners, levels, strict=True) if level == 0.0]
    closed = [*zip(corners, levels, strict=True), (corners[0], levels[0])]
    for (start, before), (end, after) in pairwise(closed):
        if before * after < 0.0:
            found.append(start + (end - start) * before / (before - after))
    if not found:
        return np.zeros((0, 2))
    points = np.array(found)
    order = np.argsort(points @ along)
    return points[order[[0, -1]]]


@dataclass(frozen=True)
class Ellipse:
    """What is circulated, in the plane z = center[2].

    Attributes:
        center: (3,) [m].
        radii: along x and y [m].
        speed: ζ [m/s].
    """

    center: tuple[float, float, float]
    radii: tuple[float, float]
    speed: float

    @property
    def length(self) -> float:
        """Once round [m], by Ramanujan's formula: exact to 1e-7 for such an ellipse."""
        a, b = self.radii
        h = ((a - b) / (a + b)) ** 2
        return math.pi * (a + b) * (1.0 + 3.0 * h / (10.0 + math.sqrt(4.0 - 3.0 * h)))

    def angle(self, path: Array) -> Array:
        """Where on the ellipse, without jumps, (ticks,) [rad]."""
        x, y = (path[:, :2] - self.center[:2]).T / np.array(self.radii)[:, None]
        return np.asarray(np.unwrap(np.arctan2(y, x)), np.float64)

    def alpha(self, path: Array) -> Array:
        """Both functions that vanish on it, (ticks, 2) [m]."""
        d = path - np.array(self.center)
        level = ((d[:, :2] / np.array(self.radii)) ** 2).sum(axis=1) - 1.0
        return np.stack([0.5 * math.sqrt(math.prod(self.radii)) * level, d[:, 2]], axis=1)

    def tangent(self, path: Array) -> Array:
        """Unit vector along it, from x to y, (ticks, 3)."""
        x, y = (path[:, :2] - self.center[:2]).T / np.array(self.radii)[:, None] ** 2
        along = np.stack([-y, x, np.zeros_like(x)], axis=1)
        return np.asarray(along / np.linalg.norm(along, axis=1)[:, None], np.float64)
