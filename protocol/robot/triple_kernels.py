"""Compiled: vectors of three numbers as tuples, which live in registers."""

from __future__ import annotations

from hoap3.protocol.runtime.numba_jit import inlined

Triple = tuple[float, float, float]


@inlined
def cross(a: Triple, b: Triple) -> Triple:
    """Vector product a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inlined
def plus(a: Triple, factor: float, b: Triple) -> Triple:
    """Sum a + factor·b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]
