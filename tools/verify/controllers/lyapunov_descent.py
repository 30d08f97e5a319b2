"""`qp12`, `pinv` and `osqp`: V, V̇, ρ, margin and optimality of a point that goes to a target.

Gonçalves et al., IEEE T-RO 2020, section V.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import schema
from hoap3.remote_controller.solvers.lyapunov_qp.reference import descent_rate
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.point_task import PointTask
from hoap3.tools.verify.sent_velocity import DELAYED, check_values, judged, sent_velocity

Array = NDArray[np.float64]

DEFAULTS: dict[str, Any] = {
    "u_max_rad_s": 0.6,
    "beta": 46.0,
    "psi_scale": "inverse_sqrt_n",
    "ramp_s": 0.0,
    "kinematics_from": "measured",
    "gamma": 0.5,
    "adaptive_gamma": False,
    "law": "lyapunov",
    "gain_per_s": 10.0,
}
CHOICES = {
    "psi_scale": ("inverse_sqrt_n", "one", "max_norm"),
    "kinematics_from": ("measured", "reference"),
    "law": ("lyapunov", "plain"),
    "adaptive_gamma": (False, True),
}
CERTIFIED = schema("Setpoint").constants["STATUS_CERTIFIED"]
PLACE = 8.0 * float(np.finfo(float).eps)  # m: how exactly a place is known
OPTIMAL = 1e-9  # greatest residual of a certified answer


@dataclass(frozen=True)
class Descent:
    """What each cycle's problem is; one row for each answer.

    Attributes:
        V: (N,) [m²].
        gradient: ∇V, (N, n).
        step: direction −J⁺e of the pseudo-inverse, (N, n); empty where nobody asks for it.
        psi: Ψ, (N,).
        share: of u_max, while Ψ rises, (N,).
    """

    V: Array
    gradient: Array
    step: Array
    psi: Array
    share: Array


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that the certificate of `qp12` and `osqp` says: (40), optimal by (31), (32)."""
    _check(run, {**DEFAULTS, **parameters}, claims, inverse=False)


def check_pinv(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """The same of `pinv`: u along −J⁺e with the same V̇, or u = −k·J⁺e."""
    _check(run, {**DEFAULTS, **parameters}, claims, inverse=True)


def _check(
    run: ControllerRun, settings: Mapping[str, Any], claims: Claims, *, inverse: bool
) -> None:
    wrong = _unreadable(settings)
    task = None if wrong else PointTask.of(run.description, settings)
    if task is None:
        claims.unverified("certificate", len(run.answers), wrong or "the log names no target")
        return
    delayed = run.description.delay_ticks > 0
    if delayed and settings["kinematics_from"] == "reference":
        claims.unverified("certificate", len(run.answers), DELAYED)
        return
    run = judged(run, claims)
    if not len(run.answers):
        return
    problem = _problems(run, task, settings, inverse=inverse)
    answers, tick = run.answers, run.answers["tick"]
    plain = inverse and settings["law"] == "plain"
    length = np.sqrt(2.0 * problem.V)  # |e|, known to PLACE
    claims.equal("V", tick, answers["v"], problem.V, RELATIVE * problem.V + length * PLACE)
    required = np.zeros_like(problem.psi) if plain else -problem.psi
    share = RELATIVE + 2.0 * PLACE / np.maximum(length, PLACE)
    stated = answers["v_rate_required"]
    claims.equal("required V rate", tick, stated, required, share * np.abs(required))
    if delayed:
        claims.unverified("u", len(answers), DELAYED)
        return
    u, doubt = sent_velocity(run, settings)
    each = problem.gradient * u
    exact = RELATIVE * np.abs(each).sum(1) + (np.abs(problem.gradient) * doubt).sum(1)
    claims.equal("predicted V rate", tick, answers["v_rate_predicted"], each.sum(1), exact)
    claims.equal("rho", tick, answers["rho"], np.ones(len(tick)))
    check_values(run, settings, claims)
    _check_proof(problem, run, settings, claims, inverse=inverse)


def _unreadable(settings: Mapping[str, Any]) -> str:
    """Which parameter of the log's config is none that can be reckoned with; "" for none."""
    for key, usual in DEFAULTS.items():
        given = settings[key]
        number = isinstance(given, int | float) and not isinstance(given, bool)
        fits = (number and math.isfinite(given)) if isinstance(usual, float) else True
        if not fits or (key in CHOICES and given not in CHOICES[key]):
            return f"parameter {key} is {given!r:.40}"
    return ""


def _check_proof(
    problem: Descent,
    run: ControllerRun,
    settings: Mapping[str, Any],
    claims: Claims,
    *,
    inverse: bool,
) -> None:
    """Margin and residual of every answer; and what makes one certified."""
    answers, tick, u_max = run.answers, run.answers["tick"], settings["u_max_rad_s"]
    u, doubt = sent_velocity(run, settings)
    margin, near = u_max - np.abs(u).max(1), RELATIVE * u_max + doubt.max(1)
    claims.equal("margin", tick, answers["margin"], margin, near)
    residual, exact = (_inverse_residual if inverse else _residual)(problem, u, doubt, settings)
    claims.equal("residual", tick, answers["kkt_residual"], residual, np.maximum(exact, RELATIVE))
    if inverse:
        _check_direction(problem, u, doubt, settings, tick, claims)
    proven = answers["solver_status"] == CERTIFIED
    bound = OPTIMAL + exact[proven]
    claims.at_most("certified: residual", tick[proven], residual[proven], bound, 0.0)
    claims.at_most("certified: speed", tick[proven], -margin[proven], 0.0, near[proven])


def _problems(
    run: ControllerRun, task: PointTask, settings: Mapping[str, Any], *, inverse: bool
) -> Descent:
    which = "reference" if settings["kinematics_from"] == "reference" else "q"
    q, m, n = run.states[which][run.answered], len(run.answers), run.description.n
    V, psi, gradient = np.zeros(m), np.zeros(m), np.zeros((m, n))
    step = np.zeros((m, n)) if inverse else np.zeros((m, 0))
    share = _shares(run, settings["ramp_s"])
    form, u_max, beta = settings["psi_scale"], settings["u_max_rad_s"], settings["beta"]
    for i in range(m):
        e, J = task.at(q[i])
        V[i], gradient[i] = 0.5 * float(e @ e), J.T @ e
        length = math.sqrt(float(e @ e))
        psi[i] = descent_rate(form, V[i], gradient[i], length, u_max * share[i], beta)
        if inverse:
            step[i] = -np.linalg.pinv(J, rtol=1e-12) @ e
    return Descent(V, gradient, step, psi, share)


def _shares(run: ControllerRun, ramp_s: float) -> Array:
    """Share of Ψ at each answer: it grows with the periods since the last reset."""
    periods = (run.states["tick"] - run.states["skipped"]).astype(np.int64)
    resets = np.array(run.resets)
    begun = periods[resets[np.searchsorted(resets, run.answered, "right") - 1]]
    done, ticks = periods[run.answered] - begun + 1, ramp_s / run.description.period_s
    shares: Array = np.where(done >= ticks, 1.0, done / max(ticks, 1.0))
    return shares


def _residual(
    problem: Descent, u: Array, doubt: Array, settings: Mapping[str, Any]
) -> tuple[Array, Array]:
    """How far u is from (31) and (32), relative, and how exactly that is known, both (N,).

    With a = |∇V|, A = max a, b = Ψ and x the motion of each joint down its gradient, u is optimal
    where Σ a x = b and, for γ < 1, x_i = max(0, (a_i t − γ/(1−γ) (A − a_i))/A) with the t = x of
    a joint at A. For γ = 1 only the joints at A move.
    """
    a, b = np.abs(problem.gradient), problem.psi
    A, rows = a.max(1, keepdims=True), np.arange(len(b))
    gamma = np.full(len(b), float(settings["gamma"]))
    if settings["adaptive_gamma"]:
        slope = np.linalg.norm(problem.gradient, axis=1)
        gamma = 2.0 / np.pi * gamma * np.arctan(100.0 * slope)
    x = -np.sign(problem.gradient) * u
    x[problem.gradient == 0.0] = -np.abs(u[problem.gradient == 0.0])
    t = x[rows, a.argmax(1)][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = (gamma / (1.0 - gamma))[:, None]
        few = np.where(a == A, np.maximum(x, 0.0), 0.0)
        wanted = np.where(kappa < np.inf, np.maximum(0.0, (a * t - kappa * (A - a)) / A), few)
        span, power = np.abs(u).max(1), (a * np.abs(x)).sum(1) + b
        primal = np.abs((a * x).sum(1) - b) / power
        apart = np.where(span > 0.0, np.abs(x - wanted).max(1) / span, 0.0)
        # kappa amplifies the rounding of a and A where few joints move
        rounding = np.finfo(float).eps * (kappa[:, 0] * (kappa[:, 0] < np.inf)) / span
        exact = (a * doubt).sum(1) / power + 2.0 * doubt.max(1) / span + 64.0 * rounding
    still = (b == 0.0) & (span == 0.0)
    return np.where(still, 0.0, np.maximum(primal, apart)), np.where(still, 0.0, exact)


def _inverse_residual(
    problem: Descent, u: Array, doubt: Array, settings: Mapping[str, Any]
) -> tuple[Array, Array]:
    """Of eᵀJu = −Ψ, relative to all that adds to it, or V̇ ≤ 0 of the plain law, both (N,)."""
    rate, size = (problem.gradient * u).sum(1), np.abs(problem.gradient * u).sum(1)
    plain = settings["law"] == "plain"
    missing = np.maximum(0.0, rate) if plain else np.abs(rate + problem.psi)
    scale = size if plain else size + problem.psi
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = (np.abs(problem.gradient) * doubt).sum(1) / scale
        residual = missing / scale
    still = missing == 0.0  # so where nothing is required
    return np.where(still, 0.0, residual), np.where(scale > 0.0, exact, 0.0)


def _check_direction(
    problem: Descent,
    u: Array,
    doubt: Array,
    settings: Mapping[str, Any],
    tick: NDArray[np.uint64],
    claims: Claims,
) -> None:
    """Each u is k·(−J⁺e): of the plain law the k that is configured, else that gives V̇ = −Ψ."""
    rate = (problem.gradient * problem.step).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.where(rate == 0.0, 0.0, -problem.psi / rate)
    if settings["law"] == "plain":
        k = settings["gain_per_s"] * problem.share
    wanted = k[:, None] * problem.step
    size = np.abs(wanted).max(1, keepdims=True)
    claims.equal("u", tick, u, wanted, 1e-7 * size + doubt)
