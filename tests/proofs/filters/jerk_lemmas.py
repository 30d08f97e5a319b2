"""Lemmas of the filter with a jerk limit, in real numbers; docs/internals/proofs.md has the proof.

Units: the period, and the change of acceleration J·T of one. u and x are velocity and acceleration
over the last period, N is the greatest acceleration. The hardest brake has x − 1, x − 2, …; after m
periods of it the velocity, and how far it went, are

    u + m·x − m(m + 1)/2        m·u + x·m(m + 1)/2 − m(m + 1)(m + 2)/6
"""

from __future__ import annotations

from typing import Any

from ..lemmas import Lemma


def speed(m: Any, u: Any, x: Any) -> Any:
    """After m periods of the hardest brake."""
    return u + m * x - m * (m + 1) / 2


def rise(m: Any, u: Any, x: Any) -> Any:
    """How far they lead."""
    return m * u + x * m * (m + 1) / 2 - m * (m + 1) * (m + 2) / 6


def lemmas(planted: int = 0) -> tuple[Lemma, ...]:
    """All of them.

    Args:
        planted: adds to a number of steps: 0, or a fault that must be found.
    """
    import z3

    m, k, n, u, x, N, V, y, room = z3.Reals("m k n u x N V y room")
    lows, highs = z3.Reals("low1 low2 low3"), z3.Reals("high1 high2 high3")
    turn = N * n * (n + 1) / 2 - n * (n + 1) * (n + 2 - planted) / 6
    greatest, least = z3.Real("greatest"), z3.Real("least")
    return (
        Lemma("rise: its steps are the velocities", (),
              rise(m + 1, u, x) - rise(m, u, x) == speed(m + 1, u, x)),
        Lemma(
            "peak: the square root finds the last velocity that is not below 0",
            (y * y == (x - z3.Q(1, 2)) * (x - z3.Q(1, 2)) + 2 * u,
             k <= x - z3.Q(1, 2) + y, x - z3.Q(1, 2) + y < k + 1, x - z3.Q(1, 2) - y <= k),
            z3.And(speed(k, u, x) >= 0, speed(k + 1, u, x) < 0),
        ),
        Lemma("walls: a brake that ends before one goes on to do so",
              (rise(m + 1, u, x) <= room,),
              rise(m, u + x - 1, x - 1) <= room - (u + x - 1)),
        Lemma("walls: so does one at the greatest acceleration",
              ((m + 1) * u - N * (m + 1) * (m + 2) / 2 <= room,),
              m * (u - N) - N * m * (m + 1) / 2 <= room - (u - N)),
        Lemma("velocity: what can be released in time still can a period later",
              (u + (m + 1) * x - (m + 1) * m / 2 <= V,),
              (u + x) + m * (x - 1) - m * (m - 1) / 2 <= V),
        Lemma("velocity: and the shortcut u + x(x + 1)/2 + 1/8 ≤ V is enough for it",
              (u + x * (x + 1) / 2 + z3.Q(1, 8) <= V,),
              u + m * x - m * (m - 1) / 2 <= V),
        Lemma("top: no brake is faster than u + x²/2", (m >= 0,),
              speed(m, u, x) <= u + x * x / 2),
        Lemma("both walls: who turns round rises by no more than 2/3 N³", (n >= 1, N >= 0),
              turn <= 2 * N * N * N / 3),
        Lemma("both walls: and not at all where N ≤ 1", (n >= 1, N <= 1), turn <= 0),
        Lemma("velocity and wall: a release of N gains no more than N²/2", (m >= 0,),
              m * N - m * (m + 1) / 2 <= N * N / 2),
        Lemma(
            "never empty: bounds that agree two by two agree all together (Helly)",
            (*(low <= high for low in lows for high in highs),
             z3.Or(*(greatest == low for low in lows)), z3.Or(*(least == high for high in highs))),
            greatest <= least,
        ),
        Lemma("lowered: the acceleration kept fits between the walls",
              (y * y * y == 3 * room / 2, y >= N),
              room >= 2 * N * N * N / 3),
    )  # fmt: skip
