"""The law of the setpoint filter in real numbers, and what rounding may spoil.

Units: the period, and the change of velocity A·T of one; so a joint at velocity w that brakes goes
w, w − 1, w − 2, …. To be able to stop within D from a next velocity w is, for every m ≥ 1,

    m·w − m(m − 1)/2 ≤ D                                                        (stops)

since that is the way of the first m periods, which is greatest where the velocity changes sign.
The invariant is that the hardest brake, v − 1, stops in front of either wall.
"""

from __future__ import annotations

from typing import Any

from ..lemmas import Lemma

UNIT = 2.0**-53
"""Relative rounding of one operation."""


def way(m: Any, w: Any) -> Any:
    """The first m periods of a brake from w."""
    return m * w - m * (m - 1) / 2


def lemmas(planted: int = 0) -> tuple[Lemma, ...]:
    """All of them.

    Args:
        planted: adds to the number of steps in the law: 0, or a fault that must be found.
    """
    import z3

    m, n, w, v, D, y, V, low = z3.Reals("m n w v D y V low")
    wanted, p = z3.Reals("wanted p")
    steps = n * (n - 1 + planted) / 2
    enough = (n * (n - 1) / 2 < D, n * (n + 1) / 2 >= D)
    other = z3.Or(m <= n - 1, m == n, m >= n + 1)
    inside = z3.And(v >= -V, v <= V)

    def clamped(x: Any, lower: Any, upper: Any) -> Any:
        return z3.If(x > upper, upper, z3.If(x < lower, lower, x))

    fast = clamped(wanted, -V, V)
    kept = clamped(fast, v - 1, v + 1)
    slower = z3.If(p >= v - 1, p, v - 1)
    return (
        Lemma(
            "steps: the square root finds the least n with D ≤ n(n + 1)/2",
            (y * y == 1 + 8 * D, n >= 1, n - 1 < (y - 1) / 2, (y - 1) / 2 <= n),
            z3.And(*enough),
        ),
        Lemma(
            "stop: from the velocity of n steps a joint stops, for any n",
            (other, *enough, w * n == D + steps),
            way(m, w) <= D,
        ),
        Lemma(
            "greatest: from any greater velocity it does not",
            (w * n > D + steps,),
            way(n, w) > D,
        ),
        Lemma(
            "shortcut: w²/2 + w/2 + 1/8 ≤ D is enough to stop",
            (w * w / 2 + w / 2 + z3.Q(1, 8) <= D,),
            way(m, w) <= D,
        ),
        Lemma("inside: the next place is within the range", (way(1, w) <= D,), w <= D),
        Lemma(
            "invariant: after a period at w the hardest brake stops, if it did from w",
            (way(m + 1, w) <= D,),
            way(m, w - 1) <= D - w,
        ),
        Lemma(
            "other wall: nor does it come near the wall behind it",
            (m >= 1, w >= 0, low >= 0),
            way(m, -w - 1) <= low + w,
        ),
        Lemma(
            "never empty: the velocity taken is within V and A",
            (inside, p >= 0, p <= kept),
            z3.And(slower >= -V, slower <= V, slower >= v - 1, slower <= v + 1),
        ),
        *_rounding(),
        *_one_step(),
    )


def _rounding() -> tuple[Lemma, ...]:
    """That the reserve of room is more than rounding can cost a brake of k steps.

    After k steps the place has been rounded k times, of numbers up to P + room, and each velocity
    up to k times: with u = 2⁻⁵³ that is at most

        e = 1.01 u (k (P + room) + 2 way + w k (k + 1)/2)

    P is the wall's distance from 0. `stopping_speed` is right up to 8 u, the room left to it up to
    8 u of the reserve and 4 u of the room.
    """
    import z3

    k, w, V, P, room, left, e, R, most, gone = z3.Reals("k w V P room left e R most gone")
    u = z3.Q(1, 2**53)
    steady, moving, s = gone == way(k, w), w >= k - 1, V + 2
    return (
        Lemma("twice: k·w is at most twice the way", (k >= 1, moving, steady), k * w <= 2 * gone),
        Lemma("sum: w k (k + 1)/2 is at most (k + 1) ways", (k >= 1, moving, steady),
              w * k * (k + 1) / 2 <= (k + 1) * gone),
        Lemma("far: no brake is longer than s·V/2", (k >= 1, w <= V, steady), gone <= s * V / 2),
        Lemma(
            "reserve: rounding costs a brake no more than it",
            (
                k >= 1, k + 1 <= V + 2, V <= 2**20, P >= 0, room >= 0, gone <= most,
                16 * u * s * (P + z3.If(most < room, most, room)) == R,
                left <= room - R + 8 * u * R + 4 * u * room,
                gone <= left + 16 * u * gone,
                e == z3.Q(101, 100) * u * (k * (P + room) + 2 * gone + (k + 1) * gone),
            ),
            gone + e <= room,
        ),
    )  # fmt: skip


def _one_step() -> tuple[Lemma, ...]:
    """What the roundings of one period add up to, by the standard model: each is u at most.

    Velocities count as ways per period, so a = A·T², and M is the greater of |q| and |q′|. A
    product or quotient may be so small that it loses more than u of itself, by less than `tiny`. By
    symmetry the velocity rises, or the setpoint is d above q. `moved` is a result before it is
    clipped, b at least |v|; `slack` and `tight` are those of `taken_over` and `follow_one`.
    """
    import z3

    u = z3.Q(1, 2**53)
    v, b, V, a, M, q, after, d = z3.Reals("v b V a M q after d")
    change, w, moved, tiny, total, tight, slack, apart, low = z3.Reals(
        "change w moved tiny total tight slack apart low"
    )
    braked = (b <= V, moved <= v + change + u * (b + change), w <= moved)
    kept = change <= (1 - z3.Q(1, 10**12)) * (1 + 3 * u) * a
    clip = (b >= -v, b <= V, total <= (b + change) * (1 + u))
    less = tight >= change - 4 * u * total - u * change
    lowest = low >= v + tight - u * (b + change)
    asked = (
        d >= 0, apart >= d * (1 - u), moved >= apart * (1 - u) - tiny,
        tiny <= u * V, slack <= 2 * u * (M + 3 * d) * (1 + 5 * u) + tiny,
        moved <= (V + slack) * (1 + u),
    )  # fmt: skip
    near = moved - v <= (change + slack) * (1 + z3.Q(21, 10) * u)
    epsilon = 10 * u * (M + 3 * V)
    return (
        Lemma("change: what is approached changes the velocity by AT + uV at most",
              (*braked, kept, a >= 0), w - v <= a + u * V),
        Lemma("change: and by AT where V is at most 8000 AT",
              (*braked, kept, change >= 0, 8000 * a >= V), w - v <= a),
        Lemma("change: what is taken over by AT at most",
              (change <= a * (1 + u), change >= 0, b >= 0, total >= (b + change) * (1 - u),
               tight <= change - 4 * u * total + u * change, w <= v + tight + u * (b + change)),
              w - v <= a),
        Lemma("step: what is approached differs from v′T by no more than ε/5",
              (w <= V, w >= -V, M >= 0, tiny <= u * V,
               moved - w <= u * V + tiny, after - (q + moved) <= u * M),
              after - q - w <= 2 * u * (M + 3 * V)),
        Lemma("step: so does what is taken over as it is", (*asked, M >= 0, w == moved),
              d - w <= epsilon),
        Lemma("step: what is taken over with V differs by no more than ε", (*asked, M >= 0, w == V),
              d - w <= epsilon),
        Lemma("step: so does what is taken over with all of A",
              (*asked[1:], *clip, d <= 2 * M, less, lowest, near, w == low, w <= moved),
              d - w <= epsilon),
    )  # fmt: skip
