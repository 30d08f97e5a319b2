"""Problem (3) of each cycle: V, its slope and drift, Ψ, bounds and rows.

    min  Φ(u)   subject to   ∇V·u + ∂V/∂t = −ρΨ,  A u ≤ b,  C u = c,  lower ≤ u ≤ upper

Gonçalves et al., IEEE T-RO 2020, (3) and (18).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import Bounds, Constraint
from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.curve_oracle import Curve
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import AnyTask
from hoap3.remote_controller.problems.stable_qp_settings import Settings
from hoap3.remote_controller.solvers.lyapunov_qp.reference import adapted_gamma, descent_rate
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]

CHUNK = 2000  # cycles whose rows are kept at a time
PLACES = 8.0 * np.finfo(float).eps  # m or rad: how exactly two ways to sum up a robot agree


@dataclass(frozen=True)
class Cycle:
    """What one cycle's problem is.

    Attributes:
        number: among the cycles.
        V, psi, drift: V, Ψ and ∂V/∂t.
        gradient: ∇V, (n,).
        gamma: γ of this cycle.
        error, rate: |e| and |∂e/∂t|; what e rests on is exact to `PLACES`.
        sensitivity: (n,) what of ∇V an error e of length 1 makes.
        lower, upper: (n,) [rad/s or m/s].
        A, b: A u ≤ b, (s, n), (s,), rows in use only; `asked` as of `constraints.base.Rows`.
        C, c: C u = c, (k, n), (k,); the last one may be the motion along a curve.
        M, y: of ½|M u − y|², for least squares.
        rejected: whether a row was left out because V could not decrease under it.
    """

    number: int
    V: float
    psi: float
    drift: float
    gradient: Array
    gamma: float
    error: float
    rate: float
    sensitivity: Array
    lower: Array
    upper: Array
    A: Array
    b: Array
    asked: NDArray[np.bool_]
    C: Array
    c: Array
    M: Array
    y: Array
    rejected: bool

    @property
    def gradient_doubt(self) -> Array:
        """How exactly ∇V is known, (n,)."""
        return PLACES * (self.sensitivity + self.error)


class Problems:
    """The problems of a run, in the order of its cycles.

    Args:
        run: whose States they are of.
        cycles: which of them.
        these: of which cycles it is asked, (N,).
        task: what V is.
        constraints: that u keeps, all on one robot with the task.
        settings: of the controller.
        robot: that all of them look at.
    """

    def __init__(
        self,
        run: ControllerRun,
        cycles: Cycles,
        these: NDArray[np.bool_],
        task: AnyTask | Curve,
        constraints: Sequence[Constraint],
        settings: Settings,
        robot: Robot,
    ) -> None:
        self._task, self._settings, self._robot = task, settings, robot
        self._cycles, self._these, self._states = cycles, these, RowsAt(run.states, cycles.places)
        self._constraints, self._period = constraints, run.description.period_s
        self._with_rows = [each for each in constraints if each.has_rows]
        self._shares = cycles.shares(settings.psi["ramp_s"], self._period)
        self.bounds = self._bounds(run.description)

    def __iter__(self) -> Iterator[Cycle]:
        which = "reference" if self._settings.rest["kinematics_from"] == "reference" else "q"
        states, robot = self._states, self._robot
        for number, q in enumerate(states[which]):
            watched = None if isinstance(self._task, Curve) else self._task
            watched = watched if watched is not None and watched.watched else None
            if not (self._these[number] or self._cycles.fresh[number] or watched):
                continue
            robot.place(q)
            if self._cycles.fresh[number]:
                self._task.begin(robot, self._time(number))
                for constraint in self._with_rows:
                    constraint.begin(states[number])
            if watched is not None:
                robot.place(states[number]["q"])
                watched.watch(robot, self._time(number))
                robot.place(q)
            if self._these[number]:
                yield self._cycle(number)

    def margins(self) -> tuple[Array, Array]:
        """Smallest margin of the constraints, and how exactly it is known, (N,) and (N,).

        inf where there is none.
        """
        least, off = np.full(len(self._states), np.inf), np.zeros(len(self._states))
        for each in self._constraints:
            smaller = each.margins < least
            least = np.where(smaller, each.margins, least)
            off = np.where(smaller, PLACES * each.amplifies, off)
        return least, off

    def _cycle(self, number: int) -> Cycle:
        task, settings = self._task.at(self._robot, self._time(number)), self._settings
        gradient, V = task.gradient, task.value
        n, objective = gradient.size, settings.objective
        error = math.sqrt(2.0 * V)
        psi = self._psi(V, gradient, error) * float(self._shares[number])
        gamma = float(objective.get("gamma", 0.0))
        if objective.get("adaptive_gamma"):
            gamma = adapted_gamma(gradient, gamma, objective["gamma_slope"])
        A, b, asked = [np.zeros((0, n))], [np.zeros(0)], [np.zeros(0, bool)]
        C, c, rejected = [np.zeros((0, n))], [np.zeros(0)], False
        lower, upper = self.bounds.lower[number], self.bounds.upper[number]
        for constraint in self._with_rows:
            rows = constraint.rows(self._states[number], number)
            if not constraint.accepts(gradient):
                rejected = True
                continue
            if constraint.equality:
                C.append(rows.A)
                c.append(rows.b)
                continue
            sides, on = rows.b, rows.b < np.inf
            if constraint.yields and constraint.margins[number] < 0.0:
                sides = _slow_returns(rows.A, sides, lower, upper)
            A.append(rows.A[on])
            b.append(sides[on])
            asked.append(rows.asked[on])
        M, y = np.zeros((0, n)), np.zeros(0)
        if objective["kind"] == "least_squares":
            M, y = task.jacobian, -objective["gain_per_s"] * task.error
        if isinstance(self._task, Curve):
            C.append(self._task.motion_row[None])
            c.append(np.array([self._task.speed]))
            M, y = np.sqrt(self._task.weights)[:, None] * task.jacobian, np.zeros(task.error.size)
        return Cycle(
            number, V, psi, task.value_rate, gradient, gamma, error,
            float(np.linalg.norm(task.rate)), np.linalg.norm(task.jacobian, axis=0), lower, upper,
            np.vstack(A), np.concatenate(b), np.concatenate(asked),
            np.vstack(C), np.concatenate(c), M, y, rejected,
        )  # fmt: skip

    def _psi(self, V: float, gradient: Array, error: float) -> float:
        psi: Mapping[str, Any] = self._settings.psi
        first, second = psi["u_max_rad_s"], psi["beta"]
        if psi["form"] in {"tanh", "exponential"}:
            first, second = psi["eta_per_s"], psi["kappa"]
        return descent_rate(psi["form"], V, gradient, error, first, second)

    def _time(self, number: int) -> float:
        return int(self._states[number]["tick"]) * self._period

    def _bounds(self, description: RobotDescription) -> Bounds:
        """Of all cycles; those on speeds come first, so that no other asks for more."""
        shape = len(self._states), description.n
        bounds = Bounds(np.full(shape, -np.inf), np.full(shape, np.inf))
        ordered = sorted(self._constraints, key=lambda each: not each.limits_speed)
        for constraint in ordered:
            constraint.bound(self._states, self._cycles, bounds)
        return bounds


def _slow_returns(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """Sides b; no return from outside is faster than half of what the joints can do."""
    with np.errstate(invalid="ignore"):
        reach = np.where(A == 0.0, 0.0, np.minimum(A * lower, A * upper)).sum(1)
    return np.where(b < 0.0, np.maximum(b, 0.5 * reach), b)
