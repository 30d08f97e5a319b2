"""Orientations in plain numpy and scipy: `turn_kernels` is compared with it.

A rotation with its first three derivatives is one block triangular matrix, [[R, Ṙ, R̈/2, R⃛/6],
[0, R, Ṙ, R̈/2], …]: its matrix exponential and logarithm have the derivatives of theirs (Mathias
1996).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def cross_matrix(w: Array) -> Array:
    """The matrix [w]× of w × …, (3, 3)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def vector_of(matrix: Array) -> Array:
    """The vector w of [w]×, (3,)."""
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def stacked(parts: Sequence[Array]) -> Array:
    """A matrix and its derivatives as one block triangular matrix."""
    n, factorial = len(parts), np.cumprod([1, *range(1, len(parts))])
    zero = np.zeros_like(parts[0])
    return np.block(
        [[parts[j - i] / factorial[j - i] if j >= i else zero for j in range(n)] for i in range(n)]
    )


def apart(matrix: Array, count: int) -> list[Array]:
    """The inverse of `stacked`."""
    size, factorial = len(matrix) // count, np.cumprod([1, *range(1, count)])
    return [matrix[:size, k * size : (k + 1) * size] * factorial[k] for k in range(count)]


def angular_rates(rotations: Sequence[Array]) -> list[Array]:
    """ω and its derivatives of R and its derivatives: [ω]× = ṘRᵀ, and so on, each (3,)."""
    count = len(rotations)
    turned = stacked([rotation.T for rotation in rotations])
    rate = stacked([*rotations[1:], np.zeros((3, 3))])  # its last derivative is not known
    return [vector_of(each) for each in apart(rate @ turned, count)[: count - 1]]


def from_vector(anchor: Array, vector: Array) -> tuple[Rotation, Array, Array]:
    """Q, ω and dω/dt where r, ṙ and r̈ are, (3, 3)."""
    turns = apart(expm(stacked([cross_matrix(row) for row in vector])), 3)
    omega, alpha = angular_rates(turns)
    return Rotation.from_matrix(turns[0]) * Rotation.from_quat(anchor), omega, alpha


def to_vector(anchor: Array, place: Array, omega: Array, alpha: Array) -> Array:
    """The rows r, ṙ and r̈, (3, 3), |r| < π, where Q, ω and dω/dt are."""
    R = (Rotation.from_quat(place) * Rotation.from_quat(anchor).inv()).as_matrix()
    spin = cross_matrix(omega)
    parts = [R, spin @ R, (cross_matrix(alpha) + spin @ spin) @ R]
    return np.array([vector_of(each) for each in apart(np.real(logm(stacked(parts))), 3)])


def normalised(curve: Array) -> tuple[Rotation, list[Array]]:
    """The orientation of a curve of quaternions and its derivatives, (4, 4), and ω, ω̇ and ω̈."""
    rotations = [np.zeros((3, 3)) for _ in range(4)]
    square = np.zeros(4)
    binomial = [[1], [1, 1], [1, 2, 1], [1, 3, 3, 1]]
    for k in range(4):
        for i, factor in enumerate(binomial[k]):
            a, b = curve[i], curve[k - i]
            rotations[k] += factor * bilinear(a, b)
            square[k] += factor * float(a @ b)
    whole = stacked(rotations)
    scale = np.linalg.inv(stacked([np.array([[each]]) for each in square]))
    parts = apart(whole @ np.kron(scale, np.eye(3)), 4)
    return Rotation.from_quat(curve[0]), angular_rates(parts)


def bilinear(a: Array, b: Array) -> Array:
    """Of two quaternions what of one is |q|²R(q) = (w² − v·v)I + 2vvᵀ + 2w[v]×, (3, 3)."""
    v, u = a[:3], b[:3]
    scalar = float(a[3] * b[3] - v @ u)
    outer = np.outer(v, u) + np.outer(u, v)
    both = outer + a[3] * cross_matrix(u) + b[3] * cross_matrix(v)
    return np.asarray(scalar * np.eye(3) + both)
