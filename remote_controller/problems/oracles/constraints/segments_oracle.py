"""Segments and boxes: where on a segment a box is nearest, and how far; many of them at once.

A segment is a(s) = a + s·d, 0 ≤ s ≤ 1, in the axes of a box |x_i| ≤ h_i. f(s), the distance of a(s)
from the box, is convex, and f² is quadratic between the places where a(s) crosses planes of faces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOUCHING = 1e-12  # m: what is nearer is inside


def beyond(x: Array, half: Array) -> Array:
    """How far points are beyond the faces of boxes, signed, (…, 3)."""
    return np.asarray(x - np.clip(x, -half, half))


def nearest(a: Array, d: Array, half: Array) -> Array:
    """The s where f is least, (K,): the first such, or the middle of what is in the box.

    Args:
        a, d, half: (K, 3) [m].
    """
    s, slope, _ = _crossings(a, d, half)
    rows, last = np.arange(len(s)), s.shape[1] - 1
    falls = slope < 0.0  # up to some place, and not from there on
    count = falls.sum(1)
    low, high = np.clip(count - 1, 0, last), np.clip(count, 0, last)
    s0, s1, g0, g1 = s[rows, low], s[rows, high], slope[rows, low], slope[rows, high]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(g0 == g1, 0.0, g0 / (g0 - g1))
    found = np.where(count == 0, 0.0, np.where(count > last, 1.0, s0 + (s1 - s0) * share))
    inside = np.linalg.norm(beyond(a + found[:, None] * d, half), axis=1) <= TOUCHING
    if inside.any():
        found[inside] = _middle(a[inside], d[inside], half[inside], found[inside])
    return found


def distance(a: Array, d: Array, half: Array, s: Array) -> tuple[Array, Array]:
    """Signed f(s), (K,), and its gradient in the box's axes, (K, 3); inside, to the next face."""
    x = a + s[:, None] * d
    away = beyond(x, half)
    length = np.linalg.norm(away, axis=1)
    inside = length <= TOUCHING
    depth = half - np.abs(x)
    face = np.eye(3)[depth.argmin(1)] * np.where(x >= 0.0, 1.0, -1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        outwards = away / length[:, None]
    normal = np.where(inside[:, None], face, outwards)
    return np.where(inside, -np.maximum(depth.min(1), 0.0), length), normal


def furthest(a: Array, d: Array, half: Array, s: Array, end: Array, level: Array) -> Array:
    """From s, where f ≤ level, towards an end: the last place where f is still no more, (K,).

    Args:
        a, d, half: (K, 3) [m].
        s, end: (K,).
        level: (K,) [m].
    """
    sense = np.where(end > s, 1.0, -1.0)
    start, way = a + s[:, None] * d, sense[:, None] * d
    room = np.abs(end - s)
    t, slope, square = _crossings(start, way, half)
    below = (square <= (level**2)[:, None]) & (t <= room[:, None])
    rows, last = np.arange(len(s)), below.sum(1) - 1
    t0 = t[rows, np.maximum(last, 0)]
    t1 = np.minimum(t[rows, np.minimum(last + 1, t.shape[1] - 1)], room)
    g0 = slope[rows, np.maximum(last, 0)]
    g1 = (beyond(start + t1[:, None] * way, half) * way).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = np.where(t1 > t0, (g1 - g0) / (t1 - t0), 0.0)
        left = np.maximum(level**2 - square[rows, np.maximum(last, 0)], 0.0)
        more = left / (g0 + np.sqrt(np.maximum(g0 * g0 + bend * left, 0.0)))
    more = np.where(np.isfinite(more), more, room)
    reached = np.minimum(np.minimum(t0 + more, t1), room)
    return np.asarray(s + sense * np.where(last < 0, 0.0, reached))


def _crossings(a: Array, d: Array, half: Array) -> tuple[Array, Array, Array]:
    """Ascending s of the ends and where planes of faces are crossed, with f·f' and f², (K, 8)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = np.concatenate([(half - a) / d, (-half - a) / d], axis=1)
    crossed = np.clip(np.nan_to_num(crossed, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    ends = np.broadcast_to([0.0, 1.0], (len(a), 2))
    s = np.sort(np.concatenate([crossed, ends], axis=1), axis=1)
    away = beyond(a[:, None] + s[..., None] * d[:, None], half[:, None])
    return s, (away * d[:, None]).sum(2), (away**2).sum(2)


def _middle(a: Array, d: Array, half: Array, s: Array) -> Array:
    """The middle of the part of segments that is inside, (K,); s where that is a point."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - a) / d, (half - a) / d
    still = d == 0.0
    enter = np.where(still, 0.0, np.minimum(one, other)).max(1)
    leave = np.where(still, 1.0, np.maximum(one, other)).min(1)
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    return np.where(enter < leave, 0.5 * (enter + leave), s)
