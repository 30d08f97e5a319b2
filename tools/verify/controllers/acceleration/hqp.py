"""`hqp`: strict levels of tasks, one after the other (Liu, Tan and Padois, 2015, section 6).

Each level takes min |J(q̈ + Z z) − b|² + ω_r |z|² within the bounds, where Z spans what the levels
above leave. A task stands below all that have a priority of more than ½ over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Priorities
from hoap3.remote_controller.solvers.qp.reference import solve_qp
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.certificate import Solution
from hoap3.tools.verify.controllers.acceleration.fallbacks import (
    BRAKE_PER_S,
    TINY,
    Soft,
    nearest_to,
)
from hoap3.tools.verify.controllers.acceleration.family import Family, braking, check_family
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Settings = Mapping[str, Any]
Levels = tuple[tuple[int, ...], ...]

DEFAULTS: dict[str, Any] = {
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "w_r": 0.01,
    "null_damping_per_s": 10.0,
    "priorities": {},
}
ABOVE = 0.5  # more of it, and a task is a level above another
RANK = 1e-9  # of the largest singular value of a level's rows
SLACK = 1e-8  # by which bounds give way below the first level
NEAR = 1e-6  # of a unit row from its bound, which then counts as holding it


@dataclass
class Cascade:
    """Some cycles of the same levels, and how far down these are solved.

    Attributes:
        J, b: rows of all tasks and of what brakes, (N, m, n) and (N, m).
        values: [I; M], (N, 2n, n), which keeps the bounds.
        lower, upper: of it, (N, 2n).
        ddq: so far, (N, n), and how exactly it is known.
        exact: (N, n).
        b_exact: (N, m).
        bounded: whether some level reached a bound, (N,).
    """

    J: Array
    b: Array
    b_exact: Array
    values: Array
    lower: Array
    upper: Array
    ddq: Array
    exact: Array
    bounded: Flags

    def part(self, which: Flags) -> Cascade:
        """Some of the cycles."""
        return Cascade(*(getattr(self, each.name)[which] for each in fields(self)))

    def solve(
        self, levels: list[Flags], w: float, Z: Array, turned: Array, slack: float = 0.0
    ) -> None:
        """Solve the levels, (m,) flags of their rows, in what Z (N, n, d) spans.

        Z is known to an angle `turned`, (N,): what a level leaves, to the rounding of its rows over
        the least singular value of those that it takes.
        """
        if not levels or not Z.shape[2]:
            return
        J = self.J[:, levels[0]]
        A, missing = J @ Z, self.b[:, levels[0]] - _times(J, self.ddq)
        U, s, Vt = np.linalg.svd(A)
        few, V = s.shape[1], np.swapaxes(Vt, 1, 2)
        gain = V[:, :, :few] * (s / (s**2 + w))[:, None, :] @ np.swapaxes(U[:, :, :few], 1, 2)
        z = _times(gain, missing)
        self._bound(A, missing, w, Z, z, slack)
        moved = _times(Z, z)
        doubt = self.b_exact[:, levels[0]] + _times(np.abs(J), self.exact)
        size = np.linalg.norm(missing, axis=1, keepdims=True)
        large = np.linalg.norm(J, 2, axis=(1, 2))
        bent = (ROUNDING + turned * large)[:, None] / w * size
        moves = np.linalg.norm(moved, axis=1, keepdims=True)
        self.exact += _times(np.abs(Z @ gain), doubt) + bent + turned[:, None] * moves
        self.ddq += moved
        ranks = (s > RANK * large[:, None]).sum(1)
        for rank in np.unique(ranks).tolist():
            mine = ranks == rank
            below = self.part(mine)
            least = s[mine, rank - 1] if rank else np.inf
            more = turned[mine] + ROUNDING * large[mine] / least
            below.solve(levels[1:], w, Z[mine] @ V[mine][:, :, rank:], more, SLACK)
            self.ddq[mine], self.exact[mine] = below.ddq, below.exact
            self.bounded[mine] = below.bounded

    def _bound(self, A: Array, missing: Array, w: float, Z: Array, z: Array, slack: float) -> None:
        """Solve anew, within the bounds, where z does not keep them."""
        rows, at = self.values @ Z, _times(self.values, self.ddq)
        lower, upper = self.lower - slack - at, self.upper + slack - at
        held = _times(rows, z)
        near = ROUNDING * (1.0 + np.abs(held) + np.abs(at))
        out = ((held > upper - near) | (held < lower + near)).any(1)
        for i in np.flatnonzero(out):
            length = np.linalg.norm(rows[i], axis=1)
            kept = length > RANK
            sides = [each[i][kept] / length[kept] for each in (lower, upper)]
            unit = rows[i][kept] / length[kept, None]
            H = A[i].T @ A[i] + w * np.eye(A.shape[2])
            found = solve_qp(H, A[i].T @ missing[i], unit, *sides)
            if found is None:
                z[i] = np.nan
                continue
            z[i] = found
            on = np.isclose(unit @ found, sides[0], atol=NEAR) | np.isclose(
                unit @ found, sides[1], atol=NEAR
            )
            spread = np.linalg.svd(rows[i][kept][on], compute_uv=False)
            least = spread[spread > RANK].min(initial=1.0)
            self.exact[i] += ROUNDING * (1.0 + np.abs(at[i]).max()) / least
        self.bounded |= out


class Hqp(Family):
    """The cascade, anew."""

    defaults, proves = DEFAULTS, False

    def schedule(self, names: list[str], settings: Settings) -> Priorities:
        """The priorities."""
        return Priorities(names, settings["priorities"])

    def tops(self, numbers: Array) -> Flags:
        """The tasks of the first level."""
        found = np.zeros(numbers.shape[:2], bool)
        for i, levels in enumerate(_by_cycle(numbers)):
            found[i, [*levels[:1]]] = True
        return found

    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """How far the answer is from the cascade's, relative to the largest acceleration."""
        whole = _cascade(cycles, hierarchy, settings, hierarchy.torque_max)
        span = np.maximum(TINY, np.maximum(np.abs(whole.ddq), np.abs(cycles.ddq)).max(1))
        off = np.abs(cycles.ddq - whole.ddq).max(1) / span
        exact = (whole.exact + cycles.ddq_exact).max(1) / span
        return Solution(off, exact, self.proves)

    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """What is nearest to the cascade's answer with strong motors."""
        strong = np.full_like(hierarchy.torque_max, np.inf)
        found = _cascade(cycles, hierarchy, settings, strong).ddq
        wishes = np.where(np.isfinite(found), found, -BRAKE_PER_S * cycles.dq)
        return [nearest_to(wish) for wish in wishes]


def _cascade(cycles: Cycles, hierarchy: Hierarchy, settings: Settings, most: Array) -> Cascade:
    """The answers with torques up to `most`, (n,)."""
    brakes = braking(cycles, settings, hierarchy)
    N, n = brakes.shape
    one = np.broadcast_to(np.eye(n), (N, n, n))
    J, b = np.hstack([cycles.rows.jacobian, one]), np.hstack([cycles.wanted, brakes])
    b_exact = np.hstack([cycles.wanted_exact, ROUNDING * np.abs(brakes)])
    sides = [
        np.hstack([side, sign * most - cycles.bias])
        for side, sign in ((cycles.lower, -1.0), (cycles.upper, 1.0))
    ]
    values = np.hstack([one, cycles.mass])
    still = np.zeros((N, n))
    lower, upper = sides
    free = np.zeros(N, bool)
    whole = Cascade(J, b, b_exact, values, lower, upper, still, still.copy(), free)
    owner = np.repeat(np.arange(len(hierarchy.sizes) + 1), [*hierarchy.sizes, n])
    kinds = _by_cycle(cycles.numbers)
    for levels in {*kinds}:
        mine = np.array([each == levels for each in kinds])
        part = whole.part(mine)
        rows = [np.isin(owner, level) for level in (*levels, (len(hierarchy.sizes),))]
        part.solve(rows, settings["w_r"], one[mine], np.zeros(mine.sum()))
        whole.ddq[mine], whole.exact[mine] = part.ddq, part.exact
        whole.bounded[mine] = part.bounded
    return whole


def check(run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that an answer of `hqp` says."""
    check_family(Hqp(), run, parameters, claims)


def levels_of(alpha: Array) -> Levels:
    """The tasks that take part by level, highest first; a cycle of tasks shares one."""
    k = len(alpha)
    heeds = (alpha > ABOVE) & ~np.eye(k, dtype=bool)
    part = alpha.diagonal() <= ABOVE
    heeds &= part[:, None] & part[None, :]
    for _ in range(k):  # until whoever is heeded by somebody heeded is, too
        heeds |= (heeds.astype(int) @ heeds.astype(int)) > 0
    left, levels = [i for i in range(k) if part[i]], []
    while left:
        level = tuple(i for i in left if all(heeds[j, i] for j in left if heeds[i, j]))
        levels.append(level)
        left = [i for i in left if i not in level]
    return tuple(levels)


def _by_cycle(numbers: Array) -> list[Levels]:
    """The levels of each cycle."""
    changes = np.append(True, (np.diff(numbers, axis=0) != 0.0).any((1, 2)))
    found = [levels_of(alpha) for alpha in numbers[changes]]
    return [found[place] for place in (np.cumsum(changes) - 1).tolist()]


def _times(matrices: Array, vectors: Array) -> Array:
    return np.asarray((matrices @ vectors[..., None])[..., 0])
