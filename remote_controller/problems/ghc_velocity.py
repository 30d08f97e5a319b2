"""`ghc_velocity`: u answers a hierarchy with priorities, and V of the top tasks falls as certified.

Liu, Tan and Padois (2015), (13) with the velocities of section 8: the problem of `ghc` with M = I,
u for q̈, and J u = −g e − ∂e/∂t for what a task desires.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, cast

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.acceleration import Optimum
from hoap3.remote_controller.problems.check import ROUNDING, infeasibility
from hoap3.remote_controller.problems.ghc import Condensed, Values, Wanted, condensed, program_of
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    check_least,
    reason_of,
)
from hoap3.remote_controller.problems.schedule import Priorities, top_tasks
from hoap3.remote_controller.problems.statement import (
    Array,
    Claim,
    ClosedForm,
    Program,
    Rows,
    Statement,
)
from hoap3.remote_controller.problems.velocity import (
    Cycle,
    VelocityProblems,
    claim,
    claim_each,
    of_rows,
)
from hoap3.remote_controller.problems.velocity_answer import RELATIVE

STATUS = schema("Setpoint").constants
CERTIFIED, AT_TARGET, INFEASIBLE = (
    STATUS[f"STATUS_{name}"] for name in ("CERTIFIED", "AT_TARGET", "INFEASIBLE")
)
SOLVED, NO_ANSWER = 0, 1  # Setpoint.fallback
GAIN_PER_S = 5.0  # of a task
LEAST_REGULARISATION = 1e-6  # that a config may have
MOST_LOGGED = 6  # tasks whose priorities are columns
EPS = float(np.finfo(float).eps)
OPTIMAL = 1e-9  # greatest residual of an answer that counts as the optimum
ARRIVED = 1e-5  # of |e| of the top tasks [m or rad]
FIRST_ORDER = 0.01  # of V̇: by how much the fall of V in a period may differ
AT_BOUND = 1e-12  # rad/s: a joint within this of its bound is at it
SPANNED = 1e-10  # of the largest eigenvalue of S: less is rounding


class CurrentPriorities:
    """Priorities at each State.

    Args:
        priorities: at their start.
        first_tick: at which they start.

    Attributes:
        alpha: (k, k).
        settled: whether they do not change.
        top: which tasks V covers, (k,); after a change, those of new priorities when these rest.
    """

    def __init__(self, priorities: Priorities, first_tick: int) -> None:
        self._priorities, self._first, self._time_s = priorities, first_tick, 0.0
        self.alpha = priorities.goal
        self.settled, self._stale = False, True
        self.top = np.zeros(len(self.alpha), bool)

    def change(self, request: Mapping[str, Any]) -> None:
        """Apply a request, from the last evaluated tick on."""
        self._priorities.change(request, self._time_s)

    def advance(self, tick: int, period_s: float) -> None:
        """Evaluate a tick."""
        self._time_s = (tick - self._first) * period_s
        before, self.alpha = self.alpha, self._priorities.at(self._time_s)
        self.settled = bool((self.alpha == before).all()) and not self._priorities.under_way
        self._stale = self._stale or not self.settled
        if (self.settled and self._stale) or not self.top.any():
            self.top, self._stale = top_tasks(self.alpha), False


class GhcVelocityProblems(VelocityProblems):
    """The problems of `ghc_velocity`; arguments as of every `ProblemBuilder`.

    Attributes:
        gains: of the tasks [1/s], (m,).
        priorities: of the tasks at the newest State.
    """

    controller = "ghc_velocity"
    defaults: ClassVar[Mapping[str, Any]] = {
        "priorities": {},
        "regularisation": 1e-6,
        "smoothing": 0.0,
    }
    gains: Array

    def __init__(
        self,
        description: RobotDescription,
        parameters: Mapping[str, Any],
        session: Mapping[str, Any],
        controller: str = "",
    ) -> None:
        super().__init__(description, parameters, session, controller)
        self.priorities = self._start(0)

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take gains as well."""
        super().adopt(parameters)
        check_least(self.settings, "regularisation", LEAST_REGULARISATION)
        self.gains = of_rows(self.entries, self.sizes, "gain_per_s", GAIN_PER_S)

    def _start(self, first_tick: int) -> CurrentPriorities:
        try:
            priorities = Priorities(self.labels, self.settings["priorities"])
            return CurrentPriorities(priorities, first_tick)
        except NOT_READ as error:
            raise UnverifiableError(reason_of(error)) from error

    def figures(self) -> list[str]:
        """Of few tasks α, row by row."""
        names = self.labels if len(self.labels) <= MOST_LOGGED else []
        return [f"alpha_{a}_{b}" for a in names for b in names]

    def restart(self) -> None:
        """Restart the priorities."""
        self.priorities = self._start(int(self.history.state["tick"]))
        self.history.requests.clear()

    @property
    def has_memory(self) -> bool:
        """Which tasks V covers depends on earlier priorities."""
        return True

    def observe(self) -> None:
        """Evaluate priorities, and tolerances of trajectories."""
        super().observe()
        for request in self.history.requests:
            self.priorities.change(request)
        self.history.requests.clear()
        self.priorities.advance(int(self.history.state["tick"]), self.T)

    def logged_claims(self, setpoint: Any) -> list[Claim]:
        """Priorities and gains."""
        stated, told = setpoint["extra"][len(self.labels) :], setpoint["gains"]
        claims = []
        if len(stated):
            alpha = self.priorities.alpha.ravel()
            near = RELATIVE * np.maximum(np.abs(stated), alpha)
            claims.append(claim_each("alpha", stated, alpha, near))
        if len(told):
            claims.append(claim_each("gain", told, self.gains, 0.0))
        return claims

    def cycle_problem(self, setpoint: Any, cycle: Cycle, claims: list[Claim]) -> Statement:
        """State (13), and what is claimed of V."""
        claims += self._certificate_claims(setpoint, cycle)
        solved, residual = setpoint["fallback"] == SOLVED, setpoint["kkt_residual"]
        claims.append(claim("rho", setpoint["rho"], solved))
        claims.append(claim("infeasible", setpoint["solver_status"] == INFEASIBLE, not solved))
        wanted = -self.gains * cycle.e - cycle.rate
        error = self.gains * cycle.place + ROUNDING * np.abs(wanted)
        edges = np.cumsum([0, *self.sizes]).tolist()
        weight, width = float(self.settings["regularisation"]), float(self.settings["smoothing"])
        rows = Wanted(cycle.J, wanted, error, edges)
        given = condensed(rows, self.priorities.alpha, weight, width)
        if solved:
            best, _, error, exact = _optimum(given, cycle)
            program = cast("Program", best)
            spanned = program.E @ np.asarray(program.z) + program.e
            claims += [
                claim("residual", residual, 0.0, max(exact, OPTIMAL)),
                claim_each("u", cycle.u, spanned, error + _missed(cycle)),
            ]
            return Statement("optimum", (lambda: program,), spanned, error, tuple(claims))
        claims.append(claim("residual", residual, 0.0))
        if setpoint["fallback"] == NO_ANSWER:
            claims.append(_infeasibility_claim(given, cycle))
        held = np.clip(0.0, cycle.lower, cycle.upper)
        near = RELATIVE * np.maximum(np.abs(cycle.lower), np.abs(cycle.upper)) + AT_BOUND
        problem = partial(ClosedForm, (held,), near)
        return Statement("no answer", (problem,), cycle.u, cycle.u_error, tuple(claims))

    def _certificate_claims(self, setpoint: Any, cycle: Cycle) -> list[Claim]:
        """V of the top tasks, its rate, and what makes an answer certified."""
        priorities, T, place, status = (
            self.priorities,
            self.T,
            cycle.place,
            setpoint["solver_status"],
        )
        on = np.repeat(priorities.top, self.sizes).astype(float)
        e, ahead = on * np.abs(cycle.e), on * np.abs(cycle.ahead)
        V, end = 0.5 * float(e @ e), 0.5 * float(ahead @ ahead)
        slope, stated = on * cycle.e, float(setpoint["v"])
        size = np.abs(cycle.rate) + np.abs(cycle.J) @ np.abs(cycle.u)
        rate = float(slope @ (cycle.rate + cycle.J @ cycle.u))
        led = float(np.abs(slope @ cycle.J) @ cycle.u_error)
        exact = led + float((RELATIVE * e + on * place) @ size)
        claims = [
            claim("V", stated, V, RELATIVE * V + float((e + on * place) @ place)),
            claim("required V rate", setpoint["v_rate_required"], 0.0),
            claim("predicted V rate", setpoint["v_rate_predicted"], rate, exact),
        ]
        solved = setpoint["fallback"] == SOLVED and setpoint["kkt_residual"] <= OPTIMAL
        solved = solved and priorities.settled and bool(priorities.top.any())
        if status == AT_TARGET and abs(2.0 * stated - ARRIVED**2) > RELATIVE * ARRIVED**2:
            claims.append(claim("at_target", 1.0, solved and 2.0 * stated <= ARRIVED**2))
        if status == CERTIFIED:
            rounded = float((e + ahead + 2.0 * on * place) @ place) + 8.0 * EPS * (V + end)
            apart = abs((end - V) / T - rate) - FIRST_ORDER * abs(rate)
            near = rounded / T + led + exact
            claims += [
                claim("certified: optimum, settled priorities", solved, 1.0),
                claim("certified: V falls", end - V, 0.0, rounded + led * T, "at_most"),
                claim("certified: V falls at its rate", apart, 0.0, near, "at_most"),
                claim("certified: V rate", rate, 0.0, exact, "at_most"),
            ]
        return claims


def _missed(cycle: Cycle) -> Array:
    """By how much a joint at a bound may be outside what the tasks span, (n,) [rad/s or m/s].

    A bound of a joint that no task moves counts as kept where it is missed by no more than
    rounding; then u is cut to it.
    """
    at_bound = np.minimum(cycle.u - cycle.lower, cycle.upper - cycle.u) <= cycle.u_error + AT_BOUND
    return np.where(at_bound, RELATIVE * (1.0 + np.abs(cycle.u)), 0.0)


def _optimum(given: Condensed, cycle: Cycle) -> Optimum:
    """State (13) in u: the torques of `ghc` are u again, without limits."""
    none, far = np.zeros(len(cycle.u)), np.full(len(cycle.u), np.inf)
    u = Values(cycle.u, cycle.u_error, cycle.lower, cycle.upper)
    free = Values(cycle.u, cycle.u_error, -far, far)
    return program_of(given, 0.0, np.eye(len(none)), none, none, u, free, none)


def _infeasibility_claim(given: Condensed, cycle: Cycle) -> Claim:
    """No q₀ + S y is within the bounds of u by more than rounding."""
    values, vectors = np.linalg.eigh(given.S)
    spanned = vectors[:, values > SPANNED * max(values[-1], 0.0)]
    least, most = cycle.lower - given.q0, cycle.upper - given.q0
    excess = infeasibility(Rows.of(spanned, least, most))
    near = OPTIMAL * (1.0 + max(np.abs(least).max(), np.abs(most).max()))
    return claim("no velocity within the bounds", excess, 0.0, near, "at_least")
