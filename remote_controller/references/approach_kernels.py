"""Compiled: the way from where a robot is to a target that moves."""

from __future__ import annotations

from hoap3.protocol.runtime.numba_jit import Vector, kernel


@kernel()
def blend(start: Vector, s: float, s_rate: float, position: Vector, velocity: Vector) -> None:
    """Turn c and ċ into x = x₀ + s·(c − x₀) and ẋ = ṡ·(c − x₀) + s·ċ, in place.

    Args:
        start: x₀, (m,).
        s, s_rate: s, from 0 to 1, and ṡ [1/s].
        position, velocity: c and ċ, then x and ẋ, (m,).
    """
    for i in range(start.size):
        way = position[i] - start[i]
        position[i] = start[i] + s * way
        velocity[i] = s_rate * way + s * velocity[i]
