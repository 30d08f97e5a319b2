"""`ghc` and `ghc_torque`: tasks with priorities over each other (Liu, Tan and Padois, 2015).

(13) in terms of q̈ alone: min ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀) + ω_r/2 |τ − o|² within the bounds, with
S = Σ P_i H_i⁻¹ P_i, q₀ = Σ P_i J_iᵀ (J_i J_iᵀ + ω_r I)⁻¹ b_i and H_i = J_iᵀJ_i + ω_r I. q̈ is
optimal where q̈ − q₀ + S·g = 0, g = ω_r M(τ − o) and the multipliers of active bounds.
`ghc_torque` is the same with J M⁻¹ for J, τ − h for q̈ and M⁻¹ for M (section 8).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.ghc.reference import optimum
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.certificate import Solution
from hoap3.tools.verify.controllers.acceleration.fallbacks import (
    BRAKE_PER_S,
    Soft,
    nearest_to,
)
from hoap3.tools.verify.controllers.acceleration.family import Family, braking, check_family
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy
from hoap3.tools.verify.controllers.acceleration.model import bounds
from hoap3.tools.verify.controllers.acceleration.model.rounding import rounding_of
from hoap3.tools.verify.controllers.acceleration.model.schedule import Priorities, leaders
from hoap3.tools.verify.controllers.acceleration.model.wanted import ROUNDING
from hoap3.tools.verify.controllers.acceleration.projectors import Projectors
from hoap3.tools.verify.controllers.acceleration.quadratic import (
    Values,
    away,
    motion_and_torques,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
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
TORQUE_DEFAULTS = {**DEFAULTS, "w_r": 1e-4, "regularise": "none"}
SMALLEST = 1e-6  # rad/s²: accelerations below it count as that much


class Condensed(NamedTuple):
    """S (N, n, n) and q₀ (N, n), and how exactly the latter is known."""

    S: Array
    q0: Array
    exact: Array


class Ranked(Family):
    """Tasks with priorities."""

    defaults = DEFAULTS
    proves = True

    def schedule(self, names: list[str], settings: Settings) -> Priorities:
        """The priorities."""
        return Priorities(names, settings["priorities"])

    def tops(self, numbers: Array) -> Flags:
        """Those above which nothing stands."""
        changes = np.append(True, (np.diff(numbers, axis=0) != 0.0).any((1, 2)))
        found = np.array([leaders(alpha) for alpha in numbers[changes]])
        return np.asarray(found[np.cumsum(changes) - 1])


class Ghc(Ranked):
    """Accelerations as the tasks' variables."""

    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """By the conditions of the condensed problem."""
        J, b, b_exact = with_rest(cycles, braking(cycles, settings, hierarchy))
        found = condensed(J, b, b_exact, cycles.numbers, hierarchy.sizes, settings)
        ddq, tau = motion_and_torques(cycles, hierarchy.torque_max)
        form, w = settings["regularise"], settings["w_r"]
        effort = cycles.tau - (cycles.bias if form == "gravity_compensated" else 0.0)
        weight = 0.0 if form == "none" else w
        pull = weight * (cycles.mass @ effort[..., None])[..., 0]
        return Solution(*optimum_of(found, pull, weight, ddq, tau, cycles.mass), self.proves)

    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """What is nearest to the optimum with strong motors."""
        J, b, b_exact = with_rest(cycles, braking(cycles, settings, hierarchy))
        found = condensed(J, b, b_exact, cycles.numbers, hierarchy.sizes, settings)
        form, w = settings["regularise"], settings["w_r"]
        offset = cycles.bias * (form == "torque")
        rows, soft = np.vstack([np.eye(J.shape[2]), -np.eye(J.shape[2])]), []
        for i, dq in enumerate(cycles.dq):
            sides = np.concatenate([cycles.lower[i], -cycles.upper[i]])
            given = 0.0 if form == "none" else w, cycles.mass[i], offset[i]
            wish = optimum(found.S[i], found.q0[i], *given, rows, sides)
            soft.append(_nearest(wish, dq))
        return soft


class GhcTorque(Ranked):
    """Torques as the tasks' variables."""

    defaults = TORQUE_DEFAULTS

    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """The same with torques and accelerations in each other's place."""
        J, b, b_exact = with_rest(cycles, braking(cycles, settings, hierarchy))
        inverse: Array = np.linalg.inv(cycles.mass).astype(float)
        inverse = 0.5 * (inverse + np.swapaxes(inverse, 1, 2))
        found = condensed(J @ inverse, b, b_exact, cycles.numbers, hierarchy.sizes, settings)
        ddq, tau = motion_and_torques(cycles, hierarchy.torque_max)
        h = cycles.bias
        exact = tau.exact + rounding_of(cycles.mass, h, cycles.dq, 0.0 * h)
        free = Values(tau.found - h, exact, tau.lower - h, tau.upper - h)
        nothing = np.zeros_like(ddq.found)
        return Solution(*optimum_of(found, nothing, 0.0, free, ddq, inverse), self.proves)

    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """What is nearest to the optimum with strong motors."""
        J, b, b_exact = with_rest(cycles, braking(cycles, settings, hierarchy))
        inverse, soft = np.linalg.inv(cycles.mass), []
        found = condensed(J @ inverse, b, b_exact, cycles.numbers, hierarchy.sizes, settings)
        for i, dq in enumerate(cycles.dq):
            size = np.linalg.norm(inverse[i], axis=1)
            rows = np.vstack([inverse[i], -inverse[i]]) / np.tile(size, 2)[:, None]
            sides = np.concatenate([cycles.lower[i], -cycles.upper[i]]) / np.tile(size, 2)
            given = 0.0, inverse[i], np.zeros_like(dq)
            wish = optimum(found.S[i], found.q0[i], *given, rows, sides)
            soft.append(_nearest(wish, dq, inverse[i]))
        return soft


def check(run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that an answer of `ghc` says."""
    check_family(Ghc(), run, parameters, claims)


def check_torque(run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that an answer of `ghc_torque` says."""
    check_family(GhcTorque(), run, parameters, claims)


def with_rest(cycles: Cycles, brakes: Array) -> tuple[Array, Array, Array]:
    """J, b and how exactly b is known, with rows of I below that brake."""
    n = cycles.q.shape[1]
    one = np.broadcast_to(np.eye(n), (len(brakes), n, n))
    exact = np.hstack([cycles.wanted_exact, ROUNDING * np.abs(brakes)])
    return np.hstack([cycles.rows.jacobian, one]), np.hstack([cycles.wanted, brakes]), exact


def condensed(
    J: Array, b: Array, b_exact: Array, alpha: Array, sizes: list[int], settings: Settings
) -> Condensed:
    """S and q₀ of all tasks and, last, of what brakes: it heeds all that take part."""
    N, _, n = J.shape
    w, edges = settings["w_r"], np.cumsum([0, *sizes, n])
    k = len(sizes)
    whole = np.zeros((N, k + 1, k + 1))
    whole[:, :k, :k] = alpha
    whole[:, k, :k] = 1.0 - np.diagonal(alpha, axis1=1, axis2=2)
    if settings["null_damping_per_s"] == 0.0:
        whole[:, k, :] = 1.0
    projectors = Projectors(J, edges, settings["smoothing"])
    S, q0, exact = np.zeros((N, n, n)), np.zeros((N, n)), np.zeros((N, n))
    for i in range(k + 1):
        Ji, bi = J[:, edges[i] : edges[i + 1]], b[:, edges[i] : edges[i + 1]]
        P = projectors.of(whole[:, i])
        U, s, Vt = np.linalg.svd(Ji[:1] if (Ji == Ji[0]).all() else Ji)
        V, few = np.swapaxes(Vt, 1, 2), s.shape[1]
        square = np.zeros((len(s), n))
        square[:, :few] = s**2
        root = P @ V / np.sqrt(square + w)[:, None, :]
        S += root @ np.swapaxes(root, 1, 2)
        gain = P @ V[:, :, :few] * (s / (s**2 + w))[:, None, :] @ np.swapaxes(U[:, :, :few], 1, 2)
        q0 += (gain @ bi[..., None])[..., 0]
        doubt = b_exact[:, edges[i] : edges[i + 1]] + ROUNDING * np.abs(bi)
        stiff = s[:, 0] / (s[:, -1] ** 2 + w)
        size = np.linalg.norm(gain, axis=(1, 2)) * projectors.amplify + stiff
        exact += (np.abs(gain) @ doubt[..., None])[..., 0]
        exact += (ROUNDING * size * np.linalg.norm(bi, axis=1))[:, None]
    return Condensed(S, q0, exact)


def optimum_of(
    problem: Condensed, pull: Array, weight: float, x: Values, y: Values, M: Array
) -> tuple[Array, Array]:
    """The residual of x and y = M·x + …, (N,), and how exactly it is known.

    Args:
        problem: S and q₀.
        pull: ω_r M (τ − o), (N, n).
        weight: that of it, for its rounding.
        x, y: within their bounds.
        M: (N, n, n).
    """
    S, q0, q0_exact = problem
    span = np.maximum(SMALLEST, np.maximum(np.abs(x.found), np.abs(q0)).max(1))
    offset = x.found - q0 + (S @ pull[..., None])[..., 0]
    left = away(offset, S, M, np.hstack([x.active, y.active]))
    beyond = np.maximum(_beyond(x), _beyond(y))
    doubt = weight * (np.abs(M) @ y.exact[..., None])[..., 0] + ROUNDING * np.abs(pull)
    exact = x.exact + q0_exact + (np.abs(S) @ doubt[..., None])[..., 0]
    off = exact.max(1) / span + _relative(x) + _relative(y)
    return np.maximum(np.abs(left).max(1) / span, beyond), off


def _nearest(found: tuple[Array, float] | None, dq: Array, M: Array | None = None) -> Soft:
    """Of M·x of an optimum x and its condition, or of braking where there is none."""
    if found is None:
        return nearest_to(-BRAKE_PER_S * dq)
    x, condition = found
    return nearest_to(x if M is None else M @ x, ROUNDING * condition)


def _beyond(values: Values) -> Array:
    """The most that a bound is exceeded by, relative to 1 and its size, (N,)."""
    return values.beyond(1.0 + np.minimum(np.abs(values.lower), np.abs(values.upper)))


def _relative(values: Values) -> Array:
    return np.asarray((values.exact / (1.0 + np.abs(values.found))).max(1))
