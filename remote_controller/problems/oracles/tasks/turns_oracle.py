"""States of live targets that turn, and rotation vectors that lead from one orientation to another.

With R = exp[r] A, ω = Jl(r)·ṙ in the axes that both are given in, so ṙ = Jl⁻¹(r)·ω and
r̈ = Jl⁻¹·ω̇ + (dJl⁻¹/dt)·ω, with Jl⁻¹ = I − ½[r] + c[r]² of `logarithm`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    angular_velocity,
    inverse_left,
    rotation_of,
    rotation_vector,
    skew,
)

Array = NDArray[np.float64]


class State(NamedTuple):
    """Where a target is at a time, its velocity and its acceleration.

    Attributes:
        flat: of its plain numbers, (3, k).
        turn: its orientation, (3, 3), if it has one.
        spin: ω and ω̇, (2, 3); (2, 0) if it has none.
    """

    flat: Array
    turn: Array
    spin: Array

    @property
    def turns(self) -> bool:
        """Whether it has an orientation."""
        return self.spin.size > 0

    def seen_from(self, anchor: Array) -> Array:
        """The same as plain numbers and a rotation vector from an orientation, (3, d)."""
        if not self.turns:
            return self.flat
        r = rotation_vector(self.turn @ anchor.T)
        inverse, _, _ = inverse_left(r)
        rate = inverse @ self.spin[0]
        second = inverse @ self.spin[1] + _inverse_rate(r, rate) @ self.spin[0]
        return np.hstack([self.flat, [r, rate, second]])

    @classmethod
    def of(cls, seen: Array, anchor: Array, k: int) -> State:
        """The inverse of `seen_from`, of k plain numbers."""
        if seen.shape[1] == k:
            return cls(seen, np.eye(3), np.zeros((2, 0)))
        r, rate, second = seen[:, k:]
        omega = angular_velocity(-r, rate)  # in the other axes
        alpha = angular_velocity(-r, second - _inverse_rate(r, rate) @ omega)
        return cls(seen[:, :k], rotation_of(r) @ anchor, np.array([omega, alpha]))

    @classmethod
    def resting(cls, place: Array, turn: Array | None) -> State:
        """At rest at plain numbers (k,) and an orientation."""
        flat = np.zeros((3, len(place)))
        flat[0] = place
        if turn is None:
            return cls(flat, np.eye(3), np.zeros((2, 0)))
        return cls(flat, turn, np.zeros((2, 3)))

    @classmethod
    def on_curve(cls, found: Array, k: int) -> State:
        """Of a curve, its rate and that of this, (3, k), or (3, k + 4) with a quaternion p behind.

        With X(p, y) = 2(w·y_v − y_w·v + v × y_v)/|p|², p = (v, w), ω is X(p, ṗ) and ω̇ is
        X(p, p̈) − 2(p·ṗ)/|p|²·ω.
        """
        if found.shape[1] == k:
            return cls(found, np.eye(3), np.zeros((2, 0)))
        p, first, second = found[:, k:]
        square = float(p @ p)

        def across(y: Array) -> Array:
            v, w = p[:3], p[3]
            return np.asarray(2.0 * (w * y[:3] - y[3] * v + np.cross(v, y[:3])) / square)

        omega = across(first)
        alpha = across(second) - 2.0 * float(p @ first) / square * omega
        turn = Rotation.from_quat(p).as_matrix()
        return cls(found[:, :k], turn, np.array([omega, alpha]))


def aligned(quaternions: Array) -> Array:
    """Quaternions of length 1, each the nearer one of both to that before, (p, 4)."""
    found = [quaternions[0] / np.linalg.norm(quaternions[0])]
    for each in quaternions[1:]:
        unit = each / np.linalg.norm(each)
        found.append(unit if unit @ found[-1] >= 0.0 else -unit)
    return np.array(found)


def rates_of(quaternions: Array, omega: Sequence[Array] | Array) -> Array:
    """dq/dt of quaternions that turn with ω, (p, 4)."""
    found = []
    for q, w in zip(quaternions, omega, strict=True):
        v = 0.5 * (q[3] * w + np.cross(w, q[:3]))
        found.append([*v, -0.5 * float(w @ q[:3])])
    return np.array(found)


def _inverse_rate(r: Array, rate: Array) -> Array:
    """DJl⁻¹/dt, (3, 3)."""
    _, c, slope = inverse_left(r)
    cross, turning = skew(r), skew(rate)
    bent = slope * float(r @ rate) * cross @ cross
    return np.asarray(-0.5 * turning + c * (turning @ cross + cross @ turning) + bent)
