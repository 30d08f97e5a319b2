"""Compiled: the curve through the points of a chunk, quintic between two of them."""

from __future__ import annotations

from hoap3.protocol.runtime.numba_jit import Matrix, kernel
from hoap3.remote_controller.references.live.turn_kernels import normalise

LOOKS = 8
"""Times between two points at which a curve's speed, acceleration and jerk are looked at."""


@kernel()
def spline_nodes(step: float, points: Matrix, rates: Matrix, accelerations: Matrix) -> None:
    """Rates and accelerations of the natural cubic spline through points at equal times.

    (a_{i−1} + 4a_i + a_{i+1})·h²/6 = p_{i−1} − 2p_i + p_{i+1}, a = 0 at both ends, by elimination.

    Args:
        step: h [s].
        points: (p, d).
        rates: written, (p, d); scratch before.
        accelerations: written, (p, d).
    """
    last = points.shape[0] - 1
    for j in range(points.shape[1]):
        accelerations[0, j] = accelerations[last, j] = rates[0, j] = 0.0
        for i in range(1, last):  # rates hold the upper diagonal meanwhile
            bend = 6.0 * (points[i - 1, j] - 2.0 * points[i, j] + points[i + 1, j]) / (step * step)
            pivot = 4.0 - rates[i - 1, j]
            rates[i, j] = 1.0 / pivot
            accelerations[i, j] = (bend - accelerations[i - 1, j]) / pivot
        for i in range(last - 1, 0, -1):
            accelerations[i, j] -= rates[i, j] * accelerations[i + 1, j]
        for i in range(last):
            slope = (points[i + 1, j] - points[i, j]) / step
            bend = 2.0 * accelerations[i, j] + accelerations[i + 1, j]
            rates[i, j] = slope - step / 6.0 * bend
        slope = (points[last, j] - points[last - 1, j]) / step
        rates[last, j] = slope + step / 6.0 * accelerations[last - 1, j]


@kernel()
def difference_nodes(step: float, rates: Matrix, accelerations: Matrix) -> None:
    """Accelerations where rates are given: central differences, one-sided at the ends.

    Args:
        step: h [s].
        rates: (p, d).
        accelerations: written, (p, d).
    """
    last = rates.shape[0] - 1
    for i in range(last + 1):
        before, behind = max(i - 1, 0), min(i + 1, last)
        for j in range(rates.shape[1]):
            accelerations[i, j] = (rates[behind, j] - rates[before, j]) / (step * (behind - before))


@kernel()
def curve_at(elapsed: float, step: float, nodes: Matrix, d: int, out: Matrix) -> None:
    """Write position, rate, acceleration and jerk of the curve, (4, d); outside its ends as there.

    The polynomial of fifth degree between two nodes that has what they have.

    Args:
        elapsed: since the first node [s].
        step: h between two nodes [s].
        nodes: positions, rates and accelerations of each, (p, 3d).
        d: numbers of a point.
        out: written.
    """
    last = nodes.shape[0] - 1
    place = min(max(elapsed / step, 0.0), float(last))
    i = min(int(place), last - 1)
    s = place - i
    for j in range(d):
        start, end = nodes[i, j], nodes[i + 1, j]
        v0, v1 = nodes[i, d + j] * step, nodes[i + 1, d + j] * step
        a0, a1 = nodes[i, 2 * d + j] * step * step, nodes[i + 1, 2 * d + j] * step * step
        way = end - start
        c3 = 10.0 * way - 6.0 * v0 - 4.0 * v1 - 0.5 * (3.0 * a0 - a1)
        c4 = -15.0 * way + 8.0 * v0 + 7.0 * v1 + 0.5 * (3.0 * a0 - 2.0 * a1)
        c5 = 6.0 * way - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
        out[0, j] = start + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        slope = v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
        bend = a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
        out[1, j], out[2, j] = slope / step, bend / (step * step)
        out[3, j] = (6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) / (step * step * step)


@kernel()
def extremes(
    begin: float, step: float, nodes: Matrix, d: int, place: int, work: Matrix, out: Matrix
) -> None:
    """Write the greatest speed, acceleration and jerk of each axis from a time on, (3, d).

    Looked at `LOOKS` times between two nodes.

    Args:
        begin: since the first node [s].
        step, nodes, d: as of `curve_at`.
        place: first column of a quaternion, whose ω, dω/dt and d²ω/dt² are meant; −1 for none.
        work: (4, d).
        out: written.
    """
    out[:] = 0.0
    last = (nodes.shape[0] - 1) * LOOKS
    first = min(max(int(begin / step * LOOKS), 0), last)
    for look in range(first, last + 1):
        curve_at(look * step / LOOKS, step, nodes, d, work)
        if place >= 0:
            normalise(work, place)
        for k in range(3):
            for j in range(d):
                out[k, j] = max(out[k, j], abs(work[k + 1, j]))
