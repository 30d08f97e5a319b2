"""The problem that an answer solves, and what a certificate claims of it, as data.

All arrays are float64. z (N,) are the variables of a problem, and the answer (p,) is what a log
has of its solution: answer = E z + e.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Rows:
    """lower ≤ A z + a ≤ upper; equal limits make an equation.

    Attributes:
        A: (s, N).
        a, lower, upper: (s,), in the row's unit; infinite limits are none.
        error: (s,), how far a row may be beyond its limit, from rounding or by the certificate.
        A_error: (s,), rounding error of each entry of a row of A.
        optional: (s,), rows that may hold the answer, but that it need not keep.
    """

    A: Array
    a: Array
    lower: Array
    upper: Array
    error: Array
    A_error: Array
    optional: Flags

    @classmethod
    def of(
        cls,
        A: Array,
        lower: Array | float,
        upper: Array | float,
        *,
        error: Array | float = 0.0,
        A_error: Array | float = 0.0,
        optional: Flags | bool = False,
    ) -> Rows:
        """Rows without an offset; numbers stand for all rows."""
        count = len(A)

        def each(value: Array | float) -> Array:
            return value if isinstance(value, np.ndarray) else np.full(count, float(value))

        flags = optional if isinstance(optional, np.ndarray) else np.full(count, optional)
        limits = each(lower), each(upper), each(error), each(A_error)
        return cls(A, np.zeros(count), *limits, flags)

    @classmethod
    def stacked(cls, parts: Sequence[Rows]) -> Rows:
        """Rows of several, below each other."""
        parts = [part for part in parts if len(part.a)] or parts[:1]
        if len(parts) == 1:
            return parts[0]

        def joined(name: str) -> Any:
            return np.concatenate([getattr(part, name) for part in parts])

        return cls(
            joined("A"),
            joined("a"),
            joined("lower"),
            joined("upper"),
            joined("error"),
            joined("A_error"),
            joined("optional"),
        )


@dataclass(frozen=True)
class Program:
    """min ½|R z − r|² + c·z + Σ l1 |z| within rows; answer = E z + e.

    Attributes:
        R, r: (k, N), (k,).
        c, l1: (N,).
        rows: that z keeps.
        E, e: (p, N), (p,).
        error: (p,), how far the answer may be from the optimum, in its unit.
        z: (N,), variables that give the answer. They are a proposal, which `check` tests; None:
            they are those of the least cost.
    """

    R: Array
    r: Array
    c: Array
    l1: Array
    rows: Rows
    E: Array
    e: Array
    error: Array
    z: Array | None = None

    @classmethod
    def of(cls, R: Array, r: Array, rows: Rows, error: Array | float) -> Program:
        """Min ½|R z − r|² within rows, where the answer is z, (N,).

        Args:
            R, r: (k, N), (k,).
            rows: that z keeps.
            error: (N,), or one number for all of it.
        """
        N = R.shape[1]
        zero = np.zeros(N)
        return cls(R, r, zero, zero, rows, np.eye(N), zero, np.full(N, error))

    @cached_property
    def shows_all(self) -> bool:
        """Whether E is the identity: the answer shows all of z."""
        p, N = self.E.shape
        return p == N == np.count_nonzero(self.E) and bool((self.E.diagonal() == 1.0).all())


@dataclass(frozen=True)
class MaximalRate:
    """A z for which rate·z is as large as the rows allow, or as large as is wanted; then `then`.

    Attributes:
        rate: (N,).
        wanted: of which no more is asked.
        rows: within which the rate is as large as can be.
        retreats: shares of the largest rate by which a solver may stay inside its end, where the
            feasible set is a point that rounding may remove.
        error: how far the rate may be below, in its unit.
        then: which answer is chosen of all with the rate that was taken.
    """

    rate: Array
    wanted: float
    rows: Rows
    retreats: tuple[float, ...]
    error: float
    then: Program


class Level(NamedTuple):
    """J x → b, (m, n) and (m,)."""

    J: Array
    b: Array


@dataclass(frozen=True)
class Cascade:
    """Levels, one after the other: each changes x only where those above leave it free.

    From the x of the level above, first the shortest that keeps the equations, a level goes to
    x + Z z with min |J (x + Z z) − b|² + w |z|², where Z is an orthonormal basis of the null space
    of the equations and all J above. The answer is the last x.

    Attributes:
        levels: highest first.
        damping: w.
        rows: that x keeps.
        equations: that it keeps above all levels, of length 1.
        slack: by which x may exceed them below the first level.
        rank: singular values of J Z up to this share of the largest one of J count as 0.
        steps: (n,), Z z of each level. They are a proposal, which `check` tests.
        error: (n,), how far the answer may be from the sum of the steps.
    """

    levels: tuple[Level, ...]
    damping: float
    rows: Rows
    equations: Rows
    slack: float
    rank: float
    steps: tuple[Array, ...]
    error: Array


@dataclass(frozen=True)
class ClosedForm:
    """The answer is one of some values: several where the law is discontinuous.

    Attributes:
        allowed: of the answer, each (p,).
        error: (p,).
    """

    allowed: tuple[Array, ...]
    error: Array


@dataclass(frozen=True)
class GainProgram:
    """min (β − 1)² + δ|λ|² with C(λ, β) = LΛ + ΛLᵀ − Δt ΛLᵀLΛ − βI ⪰ 0, least ≤ Sλ ≤ most.

    Marti-Saumell et al., (12) and (20). All is in units of the desired rate β̃: λ and β divided by
    it, dt multiplied. The answer is S λ.

    Attributes:
        L, S: (m, m), (n, m).
        least, most: (n,), around 0.
        error: (n,), how far beyond these Sλ may be.
        dt, delta: Δt β̃, δ.
        gains: λ, (m,), as logged.
        gap: by how much the objective may be above its optimum.
    """

    L: Array
    S: Array
    least: Array
    most: Array
    error: Array
    dt: float
    delta: float
    gains: Array
    gap: float


Problem = Program | MaximalRate | Cascade | ClosedForm | GainProgram


class Claim(NamedTuple):
    """A number that the log states.

    Attributes:
        name: of the claim.
        stated: in the log.
        value: what it is, or its bound.
        error: how exactly the value is known.
        relation: `equal`; `at_most`: stated ≤ value; `at_least`: stated ≥ value.
    """

    name: str
    stated: float
    value: float
    error: float
    relation: Literal["equal", "at_most", "at_least"] = "equal"


@dataclass(frozen=True)
class Statement:
    """All that is claimed of one answer.

    Attributes:
        branch: which of its laws the controller followed, as the answer says.
        problems: the answer solves one of these, tried in their order; without any, nothing is
            claimed of its optimality. Each is made where it is needed.
        answer: (p,), exact to `answer_error`, (p,).
        claims: numbers that the log states.
        unverified: parts that cannot be recomputed, with the reason.
    """

    branch: str
    problems: tuple[Callable[[], Problem], ...]
    answer: Array
    answer_error: Array
    claims: tuple[Claim, ...] = ()
    unverified: tuple[tuple[str, str], ...] = ()
