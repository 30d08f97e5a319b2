"""`qp12`, `osqp` and `pinv`: V = ½|e|² of a point falls at a given rate.

Gonçalves et al., IEEE T-RO 2020, section V: e = p(q) − p_d [m], ∇V = Jᵀe (39), V̇ = ∇V·u = −Ψ (16).
`qp12` and `osqp` answer with the u of (40), which (31) and (32) show to be optimal; `pinv` with
one along −J⁺e.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.parameters import (
    UnverifiableError,
    complete,
    is_number,
    numbers,
)
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, task_of
from hoap3.remote_controller.problems.statement import (
    Array,
    Claim,
    ClosedForm,
    Problem,
    Program,
    Rows,
    Statement,
)
from hoap3.remote_controller.problems.velocity_answer import DELAYED, RELATIVE, VelocityAnswer
from hoap3.remote_controller.solvers.lyapunov_qp.reference import adapted_gamma, descent_rate

OF_TASK = "point", "reference_frame", "target_m"
DEFAULTS: dict[str, Any] = {
    **dict.fromkeys(OF_TASK),
    "u_max_rad_s": 0.6,
    "beta": 46.0,
    "error_unit": ("m", "cm", "mm"),
    "psi_scale": ("inverse_sqrt_n", "one", "max_norm"),
    "ramp_s": 0.0,
    "kinematics_from": ("measured", "reference"),
}
OF_GAMMA: dict[str, Any] = {"gamma": 0.5, "adaptive_gamma": (False, True), "gamma_slope": 100.0}
OF_OSQP: dict[str, Any] = {**OF_GAMMA, "tolerance": 1e-5}
OF_PINV: dict[str, Any] = {"law": ("lyapunov", "plain"), "gain_per_s": 10.0}
"""Of the parameters; of several choices the first. A test compares them with the controllers'."""
MOST = {"gamma": 1.0}
PER_M = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
CERTIFIED = schema("Setpoint").constants["STATUS_CERTIFIED"]
INFEASIBLE = schema("Setpoint").constants["STATUS_INFEASIBLE"]

EPS = float(np.finfo(float).eps)
PLACE = 8.0 * EPS  # m, m/rad: how exactly e and each column of J are known
OPTIMAL = 1e-9  # greatest residual of a certified answer
RANK = 1e-12  # of the largest singular value of J: less is 0
FACTORISED = 5e-4  # least det J Jᵀ, rows of length 1, from which on `pinv` may factorise it
TINY = 1e-300  # in place of a divisor of 0
KNOWN = 10.0  # times its error: the length from which on ∇V has a direction


class Descent(NamedTuple):
    """What is asked of one answer, and what the answer does.

    Attributes:
        V, length: V [m²] and |e| [m].
        error, jacobian: e, (3,) [m], and J, (3, n) [m/rad].
        gradient, gradient_error: ∇V and how exactly it is known, (n,) [m²/rad].
        steepest, steepest_error: their largest entries.
        psi, psi_error: Ψ [m²/s] and its error.
        u, u_error: of the answer, (n,) [rad/s].
        fastest: max|u|.
        rate, rate_error: ∇V·u [m²/s] and its error, without that of the sum itself.
        terms: Σ|∇V_i u_i|.
    """

    V: float
    length: float
    error: Array
    jacobian: Array
    gradient: Array
    gradient_error: Array
    steepest: float
    steepest_error: float
    psi: float
    psi_error: float
    u: Array
    u_error: Array
    fastest: float
    rate: float
    rate_error: float
    terms: float


class DescentProblems(ProblemBuilder):
    """What the three controllers share; arguments as of every `ProblemBuilder`."""

    checks_every_answer: ClassVar[bool] = True
    own: ClassVar[Mapping[str, Any]] = {}
    """Defaults of further parameters."""

    def __init__(
        self,
        description: RobotDescription,
        parameters: Mapping[str, Any],
        session: Mapping[str, Any],
        controller: str,
    ) -> None:
        super().__init__(description, parameters, session, controller)
        self.adopt(parameters)
        self._robot, self._delayed = Robot(description), description.delay_ticks > 0
        self._eye = np.eye(description.n)
        point, reference, place = (self.settings[key] for key in OF_TASK)
        place = None if place is None else numbers(place, 3, "target_m")
        self._task = task_of(default_entry(description, point, reference, place), self._robot)
        if self._delayed and self._kinematics_from == "reference":
            raise UnverifiableError(DELAYED)

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take other numbers; the ramp goes on.

        Raises:
            UnverifiableError: a value that cannot be used.
        """
        usual = {**DEFAULTS, **self.own}
        self.settings = complete(parameters, usual, "parameters", strict=False)
        for key, value in self.settings.items():
            if key in usual and is_number(value) and not 0.0 <= value <= MOST.get(key, np.inf):
                raise UnverifiableError(f"parameter {key} is {value}")
        self.u_max = float(self.settings["u_max_rad_s"])
        self.per_m = PER_M[self.settings["error_unit"]]
        measured = self.settings["kinematics_from"] == "measured"
        self._kinematics_from = "q" if measured else "reference"

    @property
    def share(self) -> float:
        """Share of u_max and of the gain, while they rise after a reset."""
        return self.history.share_of_ramp(self.settings["ramp_s"])

    @abstractmethod
    def residual(self, d: Descent) -> tuple[float, float]:
        """`kkt_residual` as the controller defines it, and how exactly it is known."""

    @abstractmethod
    def problems(self, d: Descent, setpoint: Any) -> list[Callable[[], Problem]]:
        """Of the answer."""

    def is_optimal(self, d: Descent) -> bool:
        """Whether the controller always finds the optimum here."""
        del d
        return False

    def more_claims(self, d: Descent, setpoint: Any) -> list[Claim]:
        """Claims of one controller only."""
        del d, setpoint
        return []

    def required(self, d: Descent) -> tuple[float, float]:
        """The V̇ that is required, and its error."""
        return -d.psi, d.psi_error

    def state_problem(self, setpoint: Any) -> Statement:
        """Everything that the certificate claims of an answer."""
        T = self.history.description.period_s
        answer = VelocityAnswer.of(self.history.state, setpoint, self.settings, T)
        d = self._descent(answer)
        V_error = RELATIVE * d.V + (d.length + PLACE) * PLACE
        claims = [
            Claim("V", setpoint["v"], d.V, V_error),
            Claim("required V rate", setpoint["v_rate_required"], *self.required(d)),
        ]
        if self._delayed:
            return Statement("delayed", (), d.u, d.u_error, tuple(claims), (("u", DELAYED),))
        margin, near = self.u_max - d.fastest, RELATIVE * self.u_max + float(d.u_error.max())
        rate_error = RELATIVE * d.terms + d.rate_error
        residual, exact = self.residual(d)
        claims += [
            Claim("predicted V rate", setpoint["v_rate_predicted"], d.rate, rate_error),
            Claim("rho", setpoint["rho"], 1.0, RELATIVE),
            Claim("margin", setpoint["margin"], margin, near),
            Claim("residual", setpoint["kkt_residual"], residual, max(exact, RELATIVE)),
            *answer.claims(),
        ]
        if setpoint["solver_status"] == CERTIFIED:
            claims += [
                Claim("certified: residual", residual, 0.0, OPTIMAL + exact, "at_most"),
                Claim("certified: speed", margin, 0.0, near, "at_least"),
            ]
        if self.is_optimal(d):
            claims.append(Claim("optimum: residual", residual, 0.0, OPTIMAL + exact, "at_most"))
        claims += self.more_claims(d, setpoint)
        problems = tuple(self.problems(d, setpoint))
        return Statement("answered", problems, d.u, d.u_error, tuple(claims))

    def _descent(self, answer: VelocityAnswer) -> Descent:
        self._robot.place(self.history.state[self._kinematics_from])
        e, J, _ = self._task.at(self._robot, self.history.time_s)
        gradient, squared, u, u_error = e @ J, float(e @ e), answer.u, answer.error
        length = math.sqrt(squared)
        off = PLACE * (np.sqrt((J * J).sum(0)) + length)
        form, scales = self.settings["psi_scale"], (self.u_max * self.share, self._beta_per_m)
        size, speed, each = np.abs(gradient), np.abs(u), gradient * u
        psi = descent_rate(form, 0.5 * squared, gradient, length, *scales)
        most = descent_rate(form, 0.5 * squared, size + off, length + PLACE, *scales)
        return Descent(
            V=0.5 * squared,
            length=length,
            error=e,
            jacobian=J,
            gradient=gradient,
            gradient_error=off,
            steepest=float(size.max()),
            steepest_error=float(off.max()),
            psi=psi,
            psi_error=RELATIVE * psi + most - psi,  # Ψ grows with |∇V| and |e|
            u=u,
            u_error=u_error,
            fastest=float(speed.max()),
            rate=float(each.sum()),
            rate_error=float(size @ u_error + off @ (speed + u_error)),
            terms=float(np.abs(each).sum()),
        )

    @property
    def _beta_per_m(self) -> float:
        return float(self.settings["beta"]) * self.per_m


class OsqpProblems(DescentProblems):
    """Of `osqp`, which says of each answer how far it is from optimal."""

    own = OF_OSQP

    def problems(self, d: Descent, setpoint: Any) -> list[Callable[[], Problem]]:
        """None: OSQP's tolerance is wide, and the residual says what came of it."""
        del d, setpoint
        return []

    def more_claims(self, d: Descent, setpoint: Any) -> list[Claim]:
        """∇V·u = −Ψ holds to OSQP's tolerance ε, where OSQP found a solution.

        Of a'x = 1 and x ≥ 0 its solution is off by at most ε(1 + max(1, |x|)(1 + ε)); x is u in a
        unit of at least Ψ/(8|∇V|∞). Relative to Ψ, a'x is ∇V·u.
        """
        if setpoint["solver_status"] == INFEASIBLE or d.psi == 0.0:
            return []
        size = max(1.0, 8.0 * d.fastest * (d.steepest + d.steepest_error) / d.psi)
        near = float(self.settings["tolerance"]) * (2.0 + 2.0 * size) * d.psi
        off = d.rate_error + d.psi_error + RELATIVE * (d.terms + d.psi)
        return [Claim("row to OSQP's tolerance", d.rate, -d.psi, near + off)]

    def gamma(self, d: Descent) -> tuple[float, float]:
        """γ of this cycle, and how exactly it is known."""
        gamma = float(self.settings["gamma"])
        if not self.settings["adaptive_gamma"]:
            return gamma, 0.0
        slope = float(self.settings["gamma_slope"]) * self.per_m**2
        off = 2.0 / math.pi * gamma * slope * math.sqrt(d.gradient_error @ d.gradient_error)
        gamma = adapted_gamma(d.gradient, gamma, slope)
        return gamma, off + 2.0 * EPS * gamma

    def residual(self, d: Descent) -> tuple[float, float]:
        """How far u is from (31) and (32), relative.

        With a = |∇V|, A = max a and x the motion of each joint down its gradient, u is optimal
        where Σ a x = Ψ and, for γ < 1, x_i = w_i = max(0, (a_i t − κ(A − a_i))/A) with
        κ = γ/(1 − γ) and the t = x of a joint at A. For γ = 1 only the joints at A move. The
        residual is the larger one of |Σ a x − Ψ|/(Σ|a x| + Ψ) and max|x − w|/max|u|.
        """
        if d.psi == 0.0 and d.fastest == 0.0:
            return 0.0, 0.0
        doubt, off, A = float(d.u_error.max()), d.steepest_error, d.steepest
        if off >= A:  # ∇V is all rounding: only |u|∞ ≤ Ψ/|∇V|∞ is known, (16)
            reach = self.u_max * math.sqrt(d.u.size) * self._beta_per_m
            return d.fastest / max(reach * (d.length + PLACE) + doubt, TINY), 1.0
        power, a = max(d.terms + d.psi, TINY), np.abs(d.gradient)
        gamma, gamma_off = self.gamma(d)
        primal, exact = abs(d.rate + d.psi) / power, (d.rate_error + d.psi_error) / power
        if d.fastest == 0.0:
            return primal, exact
        x = -np.sign(d.gradient) * d.u
        still = a == 0.0
        x[still] = -np.abs(d.u[still])
        if gamma < 1.0:
            t, kappa = float(x[a.argmax()]), gamma / (1.0 - gamma)
            wanted = np.maximum(0.0, (a * t - kappa * (A - a)) / A)
            # a and A are exact to `off`, so w to 2(t + κ) off/A + Δκ
            bent = 2.0 * (abs(t) + kappa) * off / A + gamma_off / (1.0 - gamma) ** 2
        else:
            wanted, bent = np.where(a >= A - 2.0 * off, np.maximum(x, 0.0), 0.0), 0.0
        apart = float(np.abs(x - wanted).max()) / d.fastest
        return max(primal, apart), exact + (bent + 2.0 * doubt) / d.fastest


class Qp12Problems(OsqpProblems):
    """Of `qp12`, which answers with the optimum."""

    own = OF_GAMMA

    def more_claims(self, d: Descent, setpoint: Any) -> list[Claim]:
        """None: the row is part of its problem."""
        del d, setpoint
        return []

    def is_optimal(self, d: Descent) -> bool:
        """Where ∇V has a direction: (40) is solved in closed form."""
        return d.steepest > KNOWN * math.sqrt(d.u.size) * d.steepest_error

    def problems(self, d: Descent, setpoint: Any) -> list[Callable[[], Problem]]:
        """(40), where ∇V has a direction and the answer a residual."""
        residual = float(setpoint["kkt_residual"])
        if not self.is_optimal(d) or not residual < np.inf:
            return []
        return [lambda: self._program(d, residual)]

    def _program(self, d: Descent, residual: float) -> Program:
        """Min γ|u|₁ + ½(1 − γ)|u|² such that ∇V·u = −Ψ.

        An answer with a residual r is within 4n·r·max|u| of the optimum (`qp12_kkt_residual`).
        """
        n, (gamma, gamma_off) = d.u.size, self.gamma(d)
        zero, psi = np.zeros(n), np.array([-d.psi])
        error = 4.0 * n * residual * d.fastest
        if gamma < 1.0:
            error += gamma_off / (1.0 - gamma) ** 2  # of κ, which is a speed
        near = d.rate_error + d.psi_error + residual * (d.terms + d.psi)
        rows = Rows(
            d.gradient[None],
            np.zeros(1),
            psi,
            psi,
            np.array([near]),
            np.array([d.steepest_error]),
            np.zeros(1, bool),
        )
        R, l1 = math.sqrt(1.0 - gamma) * self._eye, np.full(n, gamma)
        return Program(R, zero, zero, l1, rows, self._eye, zero, np.full(n, error))


class PinvProblems(DescentProblems):
    """Of `pinv`: u = −k·J⁺e, with the k that gives V̇ = −Ψ, or a given one (`law: plain`)."""

    own = OF_PINV

    @property
    def plain(self) -> bool:
        """Whether k is given, and nothing is required of V̇ but that V does not rise."""
        return bool(self.settings["law"] == "plain")

    def required(self, d: Descent) -> tuple[float, float]:
        """The V̇ that is required, and its error."""
        return (0.0, 0.0) if self.plain else super().required(d)

    def residual(self, d: Descent) -> tuple[float, float]:
        """Of ∇V·u = −Ψ, relative to all that adds to it, or of V̇ ≤ 0 of the plain law."""
        psi, off = (0.0, 0.0) if self.plain else (d.psi, d.psi_error)
        missing, scale = max(0.0, d.rate) if self.plain else abs(d.rate + psi), d.terms + psi
        exact = (d.rate_error + off) / scale if scale > 0.0 else 0.0
        return missing / scale if missing else 0.0, exact

    def problems(self, d: Descent, setpoint: Any) -> list[Callable[[], Problem]]:
        """The one answer that there is."""
        del setpoint
        return [lambda: self._closed_form(d)]

    def _closed_form(self, d: Descent) -> ClosedForm:
        step, step_off = _step(d.jacobian, d.error)
        rate, length = float(d.gradient @ step), float(np.linalg.norm(step))
        if self.plain:
            k, k_off = float(self.settings["gain_per_s"]) * self.share, 0.0
        elif rate == 0.0:
            k, k_off = 0.0, 0.0
        else:
            slope = float(np.linalg.norm(d.gradient))
            rate_off = float(d.gradient_error @ np.abs(step)) + slope * step_off
            k = -d.psi / rate
            k_off = k * rate_off / abs(rate) - d.psi_error / rate
        wanted = k * step
        off = RELATIVE * float(np.abs(wanted).max()) + abs(k) * step_off + k_off * length
        return ClosedForm((wanted,), np.full(wanted.size, off))


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
