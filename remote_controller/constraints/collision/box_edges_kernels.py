"""The edges of one box in the axes of another, as segments.

A capsule's core is the edge `CORE` of a box whose only extent is along z, and a sphere's centre is
that of a box without extent.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined

EDGES = 12  # of a box: four along x, four along y, four along z
CORE = 8
STARTS = np.array([0, 2, 4, 6, 0, 4, 1, 5, 0, 1, 2, 3])  # corners at which edges start
ENDS = np.array([1, 3, 5, 7, 2, 6, 3, 7, 4, 5, 6, 7])


@inlined
def corners(
    center: FloatArray, turn: FloatArray, half: FloatArray, corners_out: FloatArray
) -> None:
    """Write the corners of a box, (8, 3) [m]; bit i of a corner's number is its side along axis i.

    Args:
        center, turn: (3,) [m], (3, 3) where the box is, in the other one's axes.
        half: (3,) half its extents [m].
    """
    for i in range(3):
        x, y, z = turn[i, 0] * half[0], turn[i, 1] * half[1], turn[i, 2] * half[2]
        for number in range(8):
            side = x if number & 1 else -x
            side += y if number & 2 else -y
            corners_out[number, i] = center[i] + (side + z if number & 4 else side - z)


@inlined
def beside(corners: FloatArray, half: FloatArray, excess_out: FloatArray) -> float:
    """Write how far each corner is beyond the other box along its axes, (8, 3), signed [m].

    Returns:
        The least squared distance of a corner from the other box [m²].
    """
    least = math.inf
    for corner in range(8):
        total = 0.0
        for i in range(3):
            x = corners[corner, i]
            out = min(x + half[i], 0.0) + max(x - half[i], 0.0)
            excess_out[corner, i] = out
            total += out * out
        least = min(least, total)
    return least


@inlined
def edge_at_least(excess: FloatArray, number: int) -> float:
    """A lower bound of the squared distance of an edge: where both ends are beyond a face [m²]."""
    start, end = STARTS[number], ENDS[number]
    bound = 0.0
    for i in range(3):
        one, other = excess[start, i], excess[end, i]
        out = max(min(one, other), 0.0) + min(max(one, other), 0.0)
        bound += out * out
    return bound


@inlined
def segment(corners: FloatArray, number: int, a0_out: FloatArray, d_out: FloatArray) -> None:
    """Write a0 and d of an edge, a0 + s·d [m]."""
    start, end = STARTS[number], ENDS[number]
    for i in range(3):
        a0_out[i] = corners[start, i]
        d_out[i] = corners[end, i] - corners[start, i]


@inlined
def at_least(center: FloatArray, turn: FloatArray, half: FloatArray, other: FloatArray) -> float:
    """A lower bound of the squared distance of two boxes [m²].

    It is that of the second box from the one around the first that has the second one's axes.

    Args:
        center, turn: (3,) [m], (3, 3) where the first box is, in the second one's axes.
        half, other: (3,) half the extents of the first and of the second [m].
    """
    bound = 0.0
    for i in range(3):
        reach = other[i]
        for j in range(3):
            reach += abs(turn[i, j]) * half[j]
        out = max(abs(center[i]) - reach, 0.0)
        bound += out * out
    return bound
