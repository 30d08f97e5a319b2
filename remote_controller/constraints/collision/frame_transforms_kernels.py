"""Where bodies are: in the root's axes, and in each other's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined


@inlined
def _place(
    origin: FloatArray,
    rotation: FloatArray,
    center: FloatArray,
    axes: FloatArray,
    center_out: FloatArray,
    turn_out: FloatArray,
) -> None:
    """Write where a body that is fixed to a frame is in the root's axes."""
    for i in range(3):
        center_out[i] = origin[i]
        for j in range(3):
            center_out[i] += rotation[i, j] * center[j]
            turn_out[i, j] = 0.0
            for k in range(3):
                turn_out[i, j] += rotation[i, k] * axes[k, j]


@inlined
def lay_out(
    frames: tuple[FloatArray, FloatArray],
    frame_of: NDArray[np.int64],
    bodies: tuple[FloatArray, FloatArray],
    middles_out: FloatArray,
    turns_out: FloatArray,
) -> None:
    """Write where all bodies are."""
    origins, rotations = frames
    centers, axes = bodies
    for body in range(frame_of.size):
        frame = frame_of[body]
        _place(
            origins[frame],
            rotations[frame],
            centers[body],
            axes[body],
            middles_out[body],
            turns_out[body],
        )


@inlined
def into(
    placed: tuple[FloatArray, FloatArray],
    first: int,
    second: int,
    center_out: FloatArray,
    turn_out: FloatArray,
) -> None:
    """Write where the first body is in the second one's axes."""
    middles, turns = placed
    for k in range(3):
        center_out[k] = 0.0
        for i in range(3):
            center_out[k] += turns[second, i, k] * (middles[first, i] - middles[second, i])
        for j in range(3):
            turn_out[k, j] = 0.0
            for i in range(3):
                turn_out[k, j] += turns[second, i, k] * turns[first, i, j]


@inlined
def turn_round(
    center: FloatArray, turn: FloatArray, center_out: FloatArray, turn_out: FloatArray
) -> None:
    """Write where the second body is in the first one's axes, from the inverse."""
    for i in range(3):
        center_out[i] = 0.0
        for j in range(3):
            center_out[i] -= turn[j, i] * center[j]
            turn_out[i, j] = turn[j, i]


@inlined
def apart(first: FloatArray, second: FloatArray) -> float:
    """Distance of two points [m]."""
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return math.sqrt(x * x + y * y + z * z)
