"""`ghc` and `ghc_torque`: tasks with priorities over each other (Liu, Tan and Padois, 2015).

Each task has its own acceleration x_i, and the projector P_i keeps it out of the directions of
tasks above, (13): min Σ |J_i x_i − b_i|² + ω Σ |x_i|² + ω |τ − o|² with q̈ = Σ P_i x_i. For a given
q̈ the best x_i are known, and half of what is left is, but for a constant,

    ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀) + ½ ω |τ − o|²,    H_i = J_iᵀJ_i + ωI,
    S = Σ P_i H_i⁻¹ P_i,    q₀ = Σ P_i J_iᵀ(J_i J_iᵀ + ωI)⁻¹ b_i.

With S = U Uᵀ and q̈ = q₀ + U z this is ½|z|² + ½ ω |M U z + M q₀ + h − o|², strongly convex in at
most n variables however many tasks there are; it is stated like this, as S may be singular.

`ghc_torque` is the same with J M⁻¹ for J, τ − h for q̈ and M⁻¹ for M, without |τ − o|² (section 8).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hoap3.remote_controller.problems.acceleration import (
    OPTIMAL,
    AccelerationProblems,
    Optimum,
    Wish,
)
from hoap3.remote_controller.problems.acceleration_claims import RELATIVE, Cycle, rounding_of
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Priorities, top_tasks
from hoap3.remote_controller.problems.statement import Array, Flags, Program, Rows
from hoap3.remote_controller.solvers.ghc.reference import optimum

Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "w_r": 0.01,
    "null_damping_per_s": 10.0,
    "priorities": {},
    "smoothing": 0.0,
    "regularise": "gravity_compensated",
}
SMALLEST = 1e-6  # rad/s² or N m: a smaller answer counts as that large
RANK = 1e-8  # of a singular value of unit rows: less is rounding
NARROWEST = 1e-5  # of the Frobenius norm: least width in which a direction fades out
SINGULAR = 1e-13  # of the largest eigenvalue of S: less is rounding
BRAKE_PER_S = 10.0  # of −q̇, the wish where the tasks have no answer even with strong motors


class Wanted(NamedTuple):
    """J_i x_i = b_i of all tasks, below each other.

    Attributes:
        J, b: (m, n) and (m,).
        b_error: rounding error of b, (m,).
        edges: first row of each task, and m.
    """

    J: Array
    b: Array
    b_error: Array
    edges: list[int]


class Condensed(NamedTuple):
    """S (n, n) and q₀ (n,), and the rounding error of the latter."""

    S: Array
    q0: Array
    q0_error: Array


class Values(NamedTuple):
    """q̈ or τ − h of an answer, and its limits, (n,) each."""

    found: Array
    error: Array
    lower: Array
    upper: Array

    @property
    def relative_error(self) -> float:
        """The largest rounding error, relative to 1 and the value."""
        return float((self.error / (1.0 + np.abs(self.found))).max())

    def rows(self, A: Array, a: Array) -> Rows:
        """Return the limits as rows of A z + a."""
        error = self.error + RELATIVE * (1.0 + np.abs(self.found))
        return Rows.of(A, self.lower - a, self.upper - a, error=error)


class GhcProblems(AccelerationProblems):
    """The problems of `ghc`; arguments as of every `ProblemBuilder`."""

    defaults: ClassVar[Settings] = DEFAULTS

    def schedule(self, settings: Settings) -> Priorities:
        """Return the priorities."""
        return Priorities(self.names, settings["priorities"])

    def tops(self, importance: Array) -> Flags:
        """Return the tasks without any above."""
        return top_tasks(importance)

    def optimum(self, cycle: Cycle) -> Optimum:
        """State (13) in q̈."""
        ddq = Values(cycle.ddq, cycle.ddq_error, cycle.lower, cycle.upper)
        tau = Values(cycle.tau, cycle.tau_error, -self.torque_max, self.torque_max)
        weight, offset = self._effort(cycle)
        given = self._condensed(cycle, cycle.rows.jacobian), weight, cycle.M, cycle.h, offset
        return program_of(*given, ddq, tau, np.zeros(len(cycle.dq)), cycle.kept)

    def wish(self, cycle: Cycle) -> Wish:
        """Return the optimum with strong motors."""
        weight, offset = self._effort(cycle)
        S, q0, _ = self._condensed(cycle, cycle.rows.jacobian)
        one = np.eye(len(cycle.dq))
        return _wish(cycle, one, (S, q0, weight, cycle.M, cycle.h - offset), one)

    def _effort(self, cycle: Cycle) -> tuple[float, Array]:
        """Return the weight of ½|τ − o|², and o, (n,)."""
        form = self.settings["regularise"]
        offset = cycle.h if form == "gravity_compensated" else np.zeros(len(cycle.h))
        return (0.0 if form == "none" else float(self.settings["w_r"])), offset

    def _condensed(self, cycle: Cycle, J: Array) -> Condensed:
        """Return S and q₀ of all tasks and, last, of −d·q̇, d at most 1/T, below all of them.

        Args:
            cycle: of the tasks' desired accelerations and priorities.
            J: of the tasks' variables, (m, n); those of the last are q̈ or τ − h, too.
        """
        settings = self.settings
        d = min(settings["null_damping_per_s"], 1.0 / self.history.description.period_s)
        J = np.vstack([J, self._last_rows(cycle)])
        b = np.concatenate([cycle.desired, -d * cycle.dq])
        b_error = np.concatenate([cycle.desired_error, ROUNDING * np.abs(d * cycle.dq)])
        b_error = b_error + ROUNDING * np.abs(b)
        edges = [*self.edges, len(b)]
        whole = with_braking(cycle.importance, brakes=settings["null_damping_per_s"] > 0.0)
        rows = Wanted(J, b, b_error, edges)
        return condensed(rows, whole, float(settings["w_r"]), float(settings["smoothing"]))

    def _last_rows(self, cycle: Cycle) -> Array:
        """J of the last task, which brakes all joints, (n, n)."""
        return np.eye(len(cycle.dq))


class GhcTorqueProblems(GhcProblems):
    """The problems of `ghc_torque`; arguments as of every `ProblemBuilder`."""

    defaults: ClassVar[Settings] = {**DEFAULTS, "w_r": 1e-4, "regularise": "none"}
    least_w_r: ClassVar[float] = 1e-8

    def optimum(self, cycle: Cycle) -> Optimum:
        """State the problem in τ − h; the answer is τ."""
        inverse, h = _inverse(cycle.M), cycle.h
        error = cycle.tau_error + rounding_of(cycle.M, h, cycle.dq, np.zeros(len(h)))
        most = self.torque_max
        torque = Values(cycle.tau - h, error, -most - h, most - h)
        ddq = Values(cycle.ddq, cycle.ddq_error, cycle.lower, cycle.upper)
        none = np.zeros(len(h))
        given = self._condensed(cycle, cycle.rows.jacobian @ inverse), 0.0, inverse, none, none
        kept = [replace(rows, A=rows.A @ inverse) for rows in cycle.kept]
        return program_of(*given, torque, ddq, h, kept)

    def wish(self, cycle: Cycle) -> Wish:
        """Return the optimum with strong motors."""
        inverse = _inverse(cycle.M)
        S, q0, _ = self._condensed(cycle, cycle.rows.jacobian @ inverse)
        given = S, q0, 0.0, inverse, np.zeros(len(cycle.dq))
        return _wish(cycle, inverse, given, inverse)

    def _last_rows(self, cycle: Cycle) -> Array:
        return _inverse(cycle.M)


def with_braking(alpha: Array, *, brakes: bool) -> Array:
    """Return priorities (k + 1, k + 1) of tasks and, below all active ones, of what brakes."""
    k = len(alpha)
    whole = np.zeros((k + 1, k + 1))
    whole[:k, :k], whole[k, :k] = alpha, 1.0 - alpha.diagonal()
    if not brakes:
        whole[k] = 1.0
    return whole


class Projectors:
    """The generalized projectors of one stack of rows, (11).

    P = (1 − a_1) I + Σ (a_l − a_{l+1}) N_l, where a_1 > … > a_L are the priorities of tasks over
    one, and N_l projects onto the null space of the rows of all tasks with priority a_l or more.

    Args:
        J: all rows, (m, n).
        edges: first row of each task, and m.
        width: singular values below it fade out; 0: none does.

    Attributes:
        amplify: inverse of the least singular value so far, by which rounding is amplified.
    """

    def __init__(self, J: Array, edges: list[int], width: float) -> None:
        self._J, self._sizes, self._width = J, np.diff(edges), width
        self._one, self._known = np.eye(J.shape[1]), dict[tuple[bool, ...], Array]()
        parts = [J[slice(*edge)] for edge in pairwise(edges)]
        same = self._one.shape
        self._whole = np.array([p.shape == same and bool((p == self._one).all()) for p in parts])
        self.amplify = 1.0

    def of(self, alpha: Array) -> Array:
        """Return P (n, n) for the priorities of all tasks over one, (k,)."""
        levels = [*sorted({float(a) for a in alpha if a > 0.0}, reverse=True), 0.0]
        P: Array = (1.0 - levels[0]) * self._one
        for level, below in pairwise(levels):
            P = P + (level - below) * self._null_space(alpha >= level)
        return P

    def _null_space(self, tasks: Flags) -> Array:
        """Return N_l of some tasks, (n, n)."""
        key = tuple(tasks.tolist())
        if key not in self._known:
            exact = (self._whole & tasks).any()  # no joint is left
            rows = self._J[np.repeat(tasks, self._sizes)]
            self._known[key] = np.zeros_like(self._one) if exact else self._projector(rows)
        return self._known[key]

    def _projector(self, rows: Array) -> Array:
        if self._width > 0.0:
            _, s, Vt = np.linalg.svd(rows, full_matrices=False)
            least = max(self._width, NARROWEST * float(np.linalg.norm(rows)))
            t = np.minimum(s / least, 1.0)
            shares = 3.0 * t**2 - 2.0 * t**3
        else:
            length = np.linalg.norm(rows, axis=1, keepdims=True)
            _, s, Vt = np.linalg.svd(
                rows / np.where(length > 0.0, length, 1.0), full_matrices=False
            )
            shares = (s > RANK).astype(float)
            least = float(s.min(initial=1.0, where=s > RANK))
        self.amplify = max(self.amplify, 1.0 / least)
        return np.asarray(self._one - Vt.T * shares @ Vt)


def condensed(wanted: Wanted, alpha: Array, w: float, width: float) -> Condensed:
    """Return S and q₀ of tasks with priorities.

    Args:
        wanted: of the tasks.
        alpha: (k, k), of task j over task i.
        w: ω.
        width: s₀ of the projectors.
    """
    J, b, b_error, edges = wanted
    projectors, n = Projectors(J, edges, width), J.shape[1]
    S, q0, q0_error = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for row, edge in zip(alpha, pairwise(edges), strict=True):
        P, part = projectors.of(row), slice(*edge)
        left, s, Vt = np.linalg.svd(J[part])
        square = np.zeros(n)
        square[: len(s)] = s**2
        root = P @ Vt.T / np.sqrt(square + w)
        S += root @ root.T
        gain = P @ Vt[: len(s)].T * (s / (s**2 + w)) @ left[:, : len(s)].T
        q0 += gain @ b[part]
        amplified = np.linalg.norm(gain) * projectors.amplify + s[0] / (s[-1] ** 2 + w)
        q0_error += np.abs(gain) @ b_error[part]
        q0_error += ROUNDING * amplified * np.linalg.norm(b[part])
    return Condensed(S, q0, q0_error)


def roots_of(S: Array) -> tuple[Array, Array]:
    """Return V (n, N) and l (N,) of S = V diag(l²) Vᵀ."""
    values, vectors = np.linalg.eigh(S)
    kept = values > SINGULAR * values[-1]
    return vectors[:, kept], np.sqrt(values[kept])


def program_of(
    tasks: Condensed,
    weight: float,
    M: Array,
    h: Array,
    offset: Array,
    x: Values,
    y: Values,
    shift: Array,
    kept: Sequence[Rows] = (),
) -> Optimum:
    """State min ½ (x − q₀)ᵀ S⁺ (x − q₀) + ½ ω |y − o|² with y = M x + h; the answer is x + shift.

    Args:
        tasks: S and q₀.
        weight: ω.
        M, h, offset: (n, n) and (n,).
        x, y: of an answer, with their limits.
        shift: (n,).
        kept: further rows of x.
    """
    S, q0, q0_error = tasks
    V, length = roots_of(S)
    U, z = V * length, V.T @ (x.found - q0) / length
    N, n = len(z), len(q0)
    T, t = M @ U, M @ q0 + h
    R, r = np.eye(N), np.zeros(N)
    if weight > 0.0:
        R, r = np.vstack([R, np.sqrt(weight) * T]), np.append(r, np.sqrt(weight) * (offset - t))
    more = [replace(each, A=each.A @ U, a=each.A @ q0) for each in kept]
    rows = Rows.stacked([x.rows(U, q0), y.rows(T, t), *more])
    span = max(SMALLEST, float(np.abs(x.found).max()), float(np.abs(q0).max()))
    doubt = weight * (np.abs(M) @ y.error + ROUNDING * np.abs(M @ (y.found - offset)))
    exact = float((x.error + q0_error + np.abs(S) @ doubt).max()) / span
    exact += x.relative_error + y.relative_error
    error = np.full(n, span * (OPTIMAL + exact))
    program = Program(R, r, np.zeros(N), np.zeros(N), rows, U, q0 + shift, error, z)
    given = x.error + ROUNDING * float(np.linalg.norm(x.found - q0))  # of z, and E z of it
    return Optimum(program, x.found + shift, given, exact)


def _wish(
    cycle: Cycle, limits: Array, given: tuple[Array, Array, float, Array, Array], to_ddq: Array
) -> Wish:
    """Return the optimum within the limits of q̈ = `limits`·x, or braking where there is none.

    Args:
        cycle: of the bounds and rows.
        limits: (n, n).
        given: S, q₀, ω, M and h − o of the problem in x.
        to_ddq: that gives q̈ of x, (n, n).
    """
    one = np.eye(len(cycle.dq))
    all_rows = Rows.stacked([Rows.of(one, cycle.lower, cycle.upper), *cycle.kept])
    of_x = all_rows.A @ limits
    size = np.linalg.norm(of_x, axis=1)
    rows = np.vstack([of_x, -of_x]) / np.tile(size, 2)[:, None]
    sides = np.concatenate([all_rows.lower, -all_rows.upper]) / np.tile(size, 2)
    bounded = np.isfinite(sides)
    found = optimum(*given, rows[bounded], sides[bounded])
    if found is None:
        ddq = -BRAKE_PER_S * cycle.dq
        return Wish(one, ddq, ddq)
    x, condition = found
    ddq = to_ddq @ x
    return Wish(one, ddq, ddq, ROUNDING * condition, np.sqrt(condition))


def _inverse(M: Array) -> Array:
    """Return M⁻¹, symmetric to the last digit."""
    inverse = np.linalg.inv(M).astype(float)
    return np.asarray(0.5 * (inverse + inverse.T))
