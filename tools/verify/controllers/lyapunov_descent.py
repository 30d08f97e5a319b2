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
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, complete
from hoap3.remote_controller.solvers.lyapunov_qp.reference import descent_rate
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.point_task import PointTask
from hoap3.tools.verify.sent_velocity import DELAYED, check_values, judged, sent_velocity

Array = NDArray[np.float64]

DEFAULTS: dict[str, Any] = {
    "u_max_rad_s": 0.6,
    "beta": 46.0,
    "psi_scale": ("inverse_sqrt_n", "one", "max_norm"),
    "ramp_s": 0.0,
    "kinematics_from": ("measured", "reference"),
    "gamma": 0.5,
    "adaptive_gamma": (False, True),
    "gamma_slope": 100.0,
    "error_unit": ("m", "cm", "mm"),
    "law": ("lyapunov", "plain"),
    "gain_per_s": 10.0,
}
"""Of the parameters; of several choices the first."""
PER_M = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
CERTIFIED = schema("Setpoint").constants["STATUS_CERTIFIED"]
PLACE = 8.0 * float(np.finfo(float).eps)  # m, m/rad: how exactly e and each column of J are known
OPTIMAL = 1e-9  # greatest residual of a certified answer
RANK = 1e-12  # of the largest singular value of J: less is 0
FACTORISED = 5e-4  # least det J Jᵀ, rows of length 1, from which on `pinv` may factorise it


@dataclass(frozen=True)
class Descent:
    """What each cycle's problem is; one row for each answer.

    Attributes:
        V: (N,) [m²].
        gradient: ∇V, (N, n), exact to `gradient_off`, (N, n).
        step: direction −J⁺e of the pseudo-inverse, (N, n); empty where nobody asks for it.
        step_off: how exactly it is known, (N,).
        psi: Ψ, (N,), exact to `psi_off`, (N,).
        share: of u_max, while Ψ rises, (N,).
    """

    V: Array
    gradient: Array
    gradient_off: Array
    step: Array
    step_off: Array
    psi: Array
    psi_off: Array
    share: Array


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that the certificate of `qp12` and `osqp` says: (40), optimal by (31), (32)."""
    _check(run, parameters, claims, inverse=False)


def check_pinv(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """The same of `pinv`: u along −J⁺e with the same V̇, or u = −k·J⁺e."""
    _check(run, parameters, claims, inverse=True)


def _check(
    run: ControllerRun, parameters: Mapping[str, Any], claims: Claims, *, inverse: bool
) -> None:
    try:
        settings = complete(parameters, DEFAULTS, "parameters", strict=False)
        task = PointTask.of(run.description, settings)
    except UnverifiableError as error:
        claims.unverified("certificate", len(run.answers), str(error))
        return
    delayed = run.description.delay_ticks > 0
    if delayed and settings["kinematics_from"] == "reference":
        claims.unverified("certificate", len(run.answers), DELAYED)
        return
    for part in judged(run, claims).parts():
        _check_part(part, task, settings, claims, inverse=inverse)


def _check_part(
    run: ControllerRun,
    task: PointTask,
    settings: Mapping[str, Any],
    claims: Claims,
    *,
    inverse: bool,
) -> None:
    problem = _problems(run, task, settings, inverse=inverse)
    answers, tick = run.answers, run.answers["tick"]
    plain = inverse and settings["law"] == "plain"
    length = np.sqrt(2.0 * problem.V)  # |e|, known to PLACE
    claims.equal("V", tick, answers["v"], problem.V, RELATIVE * problem.V + length * PLACE)
    required, required_off = (
        0.0 * tick if plain else each for each in (-problem.psi, problem.psi_off)
    )
    claims.equal("required V rate", tick, answers["v_rate_required"], required, required_off)
    if run.description.delay_ticks:
        claims.unverified("u", len(answers), DELAYED)
        return
    u, doubt = sent_velocity(run, settings)
    each = problem.gradient * u
    exact = RELATIVE * np.abs(each).sum(1) + _rate_off(problem, u, doubt)
    claims.equal("predicted V rate", tick, answers["v_rate_predicted"], each.sum(1), exact)
    claims.equal("rho", tick, answers["rho"], np.ones(len(tick)))
    check_values(run, settings, claims)
    _check_proof(problem, run, settings, claims, inverse=inverse)


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
    q, m, n = run.answered_states[which], len(run.answers), run.description.n
    V, psi, psi_off, step_off = np.zeros((4, m))
    gradient, gradient_off = np.zeros((2, m, n))
    step = np.zeros((m, n)) if inverse else np.zeros((m, 0))
    share = _shares(run, settings["ramp_s"])
    form, u_max = settings["psi_scale"], settings["u_max_rad_s"]
    beta = settings["beta"] * PER_M[settings["error_unit"]]
    for i in range(m):
        e, J = task.at(q[i])
        V[i], gradient[i] = 0.5 * float(e @ e), J.T @ e
        length = math.sqrt(float(e @ e))
        off = gradient_off[i] = PLACE * (np.linalg.norm(J, axis=0) + length)
        psi[i] = descent_rate(form, V[i], gradient[i], length, u_max * share[i], beta)
        more = np.abs(gradient[i]) + off, length + PLACE  # Ψ grows with both
        most = descent_rate(form, V[i], *more, u_max * share[i], beta)
        psi_off[i] = RELATIVE * psi[i] + most - psi[i]
        if inverse:
            step[i], step_off[i] = _step(J, e)
    return Descent(V, gradient, gradient_off, step, step_off, psi, psi_off, share)


def _rate_off(problem: Descent, u: Array, doubt: Array) -> Array:
    """How exactly ∇V·u is known, (N,)."""
    each = np.abs(problem.gradient) * doubt + problem.gradient_off * (np.abs(u) + doubt)
    return np.asarray(each.sum(1))


def _shares(run: ControllerRun, ramp_s: float) -> Array:
    """Share of Ψ at each answer: it grows with the periods since the last reset."""
    resets = np.array(run.resets)
    begun = resets[np.searchsorted(resets, run.answered, "right") - 1]
    passed = _periods(run, run.answered) - _periods(run, begun)
    done, ticks = passed + 1, ramp_s / run.description.period_s
    shares: Array = np.where(done >= ticks, 1.0, done / max(ticks, 1.0))
    return shares


def _periods(run: ControllerRun, places: NDArray[np.int64]) -> NDArray[np.int64]:
    """Periods of the robot until each of some States, without those that it skipped."""
    states = RowsAt(run.states, places)
    return np.asarray((states["tick"] - states["skipped"]).astype(np.int64))


def _residual(
    problem: Descent, u: Array, doubt: Array, settings: Mapping[str, Any]
) -> tuple[Array, Array]:
    """How far u is from (31) and (32), relative, and how exactly that is known, both (N,).

    With a = |∇V|, A = max a, b = Ψ and x the motion of each joint down its gradient, u is optimal
    where Σ a x = b and, for γ < 1, x_i = max(0, (a_i t − γ/(1−γ) (A − a_i))/A) with the t = x of
    a joint at A. For γ = 1 only the joints at A move.
    """
    a, b, off = np.abs(problem.gradient), problem.psi, problem.gradient_off.max(1)
    A, rows = a.max(1, keepdims=True), np.arange(len(b))
    gamma, gamma_off = np.full(len(b), float(settings["gamma"])), 0.0 * b
    if settings["adaptive_gamma"]:
        slope = settings["gamma_slope"] * PER_M[settings["error_unit"]] ** 2
        length, off_by = np.linalg.norm([problem.gradient, problem.gradient_off], axis=2)
        gamma_off = 2.0 / np.pi * gamma * slope * off_by
        gamma = 2.0 / np.pi * gamma * np.arctan(slope * length)
    x = -np.sign(problem.gradient) * u
    x[problem.gradient == 0.0] = -np.abs(u[problem.gradient == 0.0])
    t = x[rows, a.argmax(1)][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa, kappa_off = gamma / (1.0 - gamma), gamma_off / (1.0 - gamma) ** 2
        steep = a >= A - 2.0 * off[:, None]
        moving = (a * t - kappa[:, None] * (A - a)) / A
        few = np.where(steep, np.maximum(x, 0.0), 0.0)
        wanted = np.where(kappa[:, None] < np.inf, np.maximum(0.0, moving), few)
        span, power = np.abs(u).max(1), (a * np.abs(x)).sum(1) + b
        primal = np.abs((a * x).sum(1) - b) / power
        apart = np.where(span > 0.0, np.abs(x - wanted).max(1) / span, 0.0)
        # a and A are exact to `off`, so wanted to 2 (t + κ) off/A + Δκ
        bent = 2.0 * (np.abs(t[:, 0]) + kappa) * off / A[:, 0] + kappa_off
        bent = np.where(kappa < np.inf, bent, 0.0) + 2.0 * doubt.max(1)
        exact = (_rate_off(problem, u, doubt) + problem.psi_off) / power
        exact += np.where(span > 0.0, bent / span, 0.0)
    residual = np.maximum(primal, apart)
    # where ∇V is all rounding, only |u|∞ ≤ Ψ/|∇V|∞ is known, (16)
    reach = settings["u_max_rad_s"] * math.sqrt(u.shape[1]) * settings["beta"]
    reach *= PER_M[settings["error_unit"]]
    fastest = reach * (np.sqrt(2.0 * problem.V) + PLACE) + doubt.max(1)
    lost, still = A[:, 0] <= off, (b == 0.0) & (span == 0.0)
    residual, exact = np.where(lost, span / fastest, residual), np.where(lost, 1.0, exact)
    return np.where(still, 0.0, residual), np.where(still, 0.0, exact)


def _inverse_residual(
    problem: Descent, u: Array, doubt: Array, settings: Mapping[str, Any]
) -> tuple[Array, Array]:
    """Of eᵀJu = −Ψ, relative to all that adds to it, or V̇ ≤ 0 of the plain law, both (N,)."""
    rate, size = (problem.gradient * u).sum(1), np.abs(problem.gradient * u).sum(1)
    plain = settings["law"] == "plain"
    missing = np.maximum(0.0, rate) if plain else np.abs(rate + problem.psi)
    scale = size if plain else size + problem.psi
    off = _rate_off(problem, u, doubt) + (0.0 if plain else problem.psi_off)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact, residual = off / scale, missing / scale
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
    rate, length = (problem.gradient * problem.step).sum(1), np.linalg.norm(problem.step, axis=1)
    slope = np.linalg.norm(problem.gradient, axis=1)
    rate_off = (problem.gradient_off * np.abs(problem.step)).sum(1) + slope * problem.step_off
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.where(rate == 0.0, 0.0, -problem.psi / rate)
        k_off = np.where(rate == 0.0, 0.0, k * rate_off / np.abs(rate) - problem.psi_off / rate)
    if settings["law"] == "plain":
        k, k_off = settings["gain_per_s"] * problem.share, 0.0 * k
    wanted = k[:, None] * problem.step
    off = RELATIVE * np.abs(wanted).max(1) + np.abs(k) * problem.step_off + k_off * length
    claims.equal("u", tick, u, wanted, off[:, None] + doubt)


def _step(J: Array, e: Array) -> tuple[Array, float]:
    """−J⁺e, (n,), and how exactly it is known: Δ(J⁺e) of Wedin, 1973, and rounding of J Jᵀ.

    With |Δe| and each column of ΔJ at most `PLACE`, |Δ(J⁺e)| ≤ |J⁺|·(|Δe| + 2|ΔJ|·|J⁺e|). Rounding
    adds 8 units of κ³ where J Jᵀ is factorised, κ of J with rows of length 1, else of |J|·|J⁺|.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    used = s > RANK * s[0]
    if not used.any():
        return np.zeros(J.shape[1]), 0.0
    step = -(Vt[used].T / s[used]) @ (U[:, used].T @ e)
    length, least = float(np.linalg.norm(step)), float(s[used][-1])
    size = np.linalg.norm(J, axis=1, keepdims=True)
    apart = np.linalg.svd(J / np.where(size > 0.0, size, 1.0), compute_uv=False)
    factorised = float(np.prod(apart)) ** 2 > FACTORISED
    rounding = (apart[0] / apart[-1]) ** 3 if factorised else s[0] / least
    off = (1.0 + 2.0 * math.sqrt(J.shape[1]) * length) / least + (1.0 + rounding) * length
    return step, PLACE * off
