"""`joint_acceleration`: each joint to its target as its bounds allow (Del Prete, RA-L 2018).

min |q̈_d − q̈|² within the bounds of q̈, with q̈_d = kp·(q_r − q) − kd·q̇: (31) and (32). A robot that
takes accelerations gets q̈, and (q, q̇) is what it measures. A robot that takes positions gets
q + T·q̇ + T²/2·q̈. There q is the commanded position of the State, and q̇ follows from the answers
before: q̇ ← q̇ + T·q̈ while the robot commands what was sent, else the rate of the commanded position
in the last period. At a reset it is the measured velocity. The rounding error of this recursion is
followed, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from hoap3.protocol.messages import COMMANDS, schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.acceleration_claims import (
    ACTIVE,
    RELATIVE,
    active_joints_claim,
    refused,
    worst,
)
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    complete,
    is_number,
    reason_of,
)
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import posture_of
from hoap3.remote_controller.problems.statement import Array, Claim, Program, Rows, Statement

Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "posture": None,
    "posture_rad": (),
    "kp": 100.0,
    "kd": None,
    "bounds": bounds.DEFAULTS,
}
STATUS = schema("Setpoint").constants
CERTIFIED, AT_TARGET, UNCERTIFIED = (
    STATUS[f"STATUS_{name}"] for name in ("CERTIFIED", "AT_TARGET", "UNCERTIFIED")
)
RESTING = 1e-9  # rad and rad/s, or m and m/s: an error and a velocity of a joint at its target
EPS = float(np.finfo(float).eps)
ROUNDING = 4.0 * EPS  # of a sum of three products, relative to the sizes of its terms
HELD = 1  # solver_path where a joint is at a bound


class JointAccelerationProblems(ProblemBuilder):
    """The problems of `joint_acceleration`; arguments as of every `ProblemBuilder`.

    Attributes:
        target: q_r, (n,) [rad or m].
        kp, kd: gains [1/s², 1/s].
        bounds: of accelerations, of a robot that starts within its ranges.
    """

    checks_every_answer: ClassVar[bool] = True
    target: Array
    kp: float
    kd: float
    bounds: bounds.Bounds

    def __init__(
        self,
        description: RobotDescription,
        parameters: Settings,
        session: Settings,
        controller: str,
    ) -> None:
        super().__init__(description, parameters, session, controller)
        kinds = {"position", "acceleration"}
        kind = next((each for each in description.command_kinds if each in kinds), None)
        if kind is None:
            raise UnverifiableError("the robot takes neither positions nor accelerations")
        if description.delay_ticks:
            raise UnverifiableError("answers are delayed, and this controller takes no delay")
        self._positions, self._command = kind == "position", COMMANDS[kind]
        self.history.needed = ("reference",) if self._positions else ("q", "dq")
        self._start = np.full(description.n, np.nan)
        self._observed = -1  # which State was observed last, counted from the start
        self._known = True
        self._q, self._v, self._v_error = np.zeros((3, description.n))
        self.adopt(parameters)

    def adopt(self, parameters: Settings) -> None:
        """Take other parameters from the newest State on."""
        description = self.history.description
        try:
            settings = complete(parameters, DEFAULTS, "parameters", strict=False)
            self.target = posture_of(description, settings["posture"], settings["posture_rad"])
            bounds.check_settings(settings["bounds"], description.n)
        except NOT_READ as error:
            raise UnverifiableError(reason_of(error)) from error
        kp, kd = settings["kp"], settings["kd"]
        if self.target.shape != (description.n,):
            raise UnverifiableError("the config names no posture of the robot")
        if kp < 0.0 or not (kd is None or is_number(kd)):
            raise UnverifiableError(f"gains are {kp} and {kd!r:.40}")
        self.kp, self.kd = float(kp), 2.0 * math.sqrt(kp) if kd is None else float(kd)
        self.bounds = bounds.Bounds.of(description, settings["bounds"])
        self._limits = self.bounds.begun(self._start)

    def restart(self) -> None:
        """Restart from the commanded position: a joint outside its range may stay there."""
        self._start = np.array(self.history.state["reference"])
        self._limits = self.bounds.begun(self._start)
        self._observed, self._known = -1, True

    def observe(self) -> None:
        """Follow the motion to the newest State, and evaluate the law there."""
        history = self.history
        state = history.state
        q = np.array(state["reference" if self._positions else "q"])
        v, v_error = np.array(state["dq"]), np.zeros(len(q))
        if self._positions and history.states == self._observed + 1 and np.isfinite(self._v).all():
            v, v_error = self._followed(q)
        self._q, self._v, self._v_error, self._observed = q, v, v_error, history.states
        around_q, around_v = _around(q, 0.0), _around(v, v_error)
        error = self.target - around_q
        desired = self.kp * error - self.kd * around_v
        lower, upper = self._limits.at(around_q, around_v)
        size = self.kp * np.abs(error[0]) + abs(self.kd) * np.abs(v)
        self._desired, self._desired_error = desired[0], _spread(desired) + ROUNDING * size
        self._lower, self._upper = lower[0], upper[0]
        self._bound_error = np.maximum(_spread(lower), _spread(upper))
        self._bound_error += ROUNDING * self._limits.scale

    def _followed(self, q: Array) -> tuple[Array, Array]:
        """Return the velocity at the newest State, and its rounding error, (n,).

        An acceleration that the last answer has is used where it is that of the law. If it is not,
        only that answer is false, and the motion goes on as the law has it.
        """
        history, T = self.history, self.history.description.period_s
        last, answer = history.last, history.last_answer
        if answer is None:  # the robot may command what was sent, or something else
            self._known = False
            return self._v, self._v_error
        if (q != answer["values"]).any():
            ticks = int(history.state["tick"]) - int(last["tick"])
            v = (q - last["reference"]) / (ticks * T)
            return v, ROUNDING * np.abs(v)
        ddq, ddq_error = self._acceleration(answer)
        law = np.clip(self._desired, self._lower, self._upper)
        near = ddq_error + np.maximum(self._desired_error, self._bound_error)
        ddq = np.where(np.abs(ddq - law) <= near, ddq, law)
        v = self._v + T * ddq
        return v, self._v_error + T * ddq_error + EPS * (np.abs(v) + T * np.abs(ddq))

    def _acceleration(self, setpoint: Any) -> tuple[Array, Array]:
        """Return q̈ of an answer to the observed State, and its rounding error, (n,)."""
        values, T = np.array(setpoint["values"]), self.history.description.period_s
        if setpoint["decision"].shape == values.shape:
            return np.array(setpoint["decision"]), np.zeros(len(values))
        if not self._positions:
            return values, np.zeros(len(values))
        off = 4.0 * np.spacing(np.abs(values)) + T * self._v_error
        return 2.0 * (values - self._q - T * self._v) / T**2, 2.0 * off / T**2

    def problem(self) -> Statement | None:
        """The problem of the newest answer; None where the log lacks what it depends on."""
        self._close(asked=True)
        history = self.history
        if not self._known or not history.known or history.answer is None:
            return None
        if not (history.finite and np.isfinite(self._v).all()):
            return refused(history.answer)
        return super().problem()

    def state_problem(self, setpoint: Any) -> Statement:
        """The problem of an answer to the newest State, and what is claimed of V."""
        n, lower, upper, bound_error = len(self._q), self._lower, self._upper, self._bound_error
        ddq, ddq_error = self._acceleration(setpoint)
        room = np.minimum(ddq - lower, upper - ddq) / self._limits.scale
        near = (bound_error + ddq_error) / self._limits.scale + RELATIVE
        least = int(np.argmin(room))
        margin, stated = min(1.0, float(room[least])), float(setpoint["margin"])
        held = HELD if stated <= 0.0 else 0
        claims = [
            *self._motion_claims(setpoint, ddq, ddq_error),
            Claim("margin", stated, margin, float(near[least])),
            Claim("held by a bound", float(setpoint["solver_path"]), held, 0.0),
            Claim("rho", float(setpoint["rho"]), 1.0, RELATIVE),
            Claim("residual", float(setpoint["kkt_residual"]), 0.0, 0.0),
            Claim("fallback", float(setpoint["fallback"]), 0.0, 0.0),
            *self._lyapunov_claims(setpoint, ddq, ddq_error),
        ]
        rows = Rows.of(np.eye(n), lower, upper, error=bound_error)
        program = Program.of(np.eye(n), self._desired, rows, self._desired_error)
        return Statement("optimum", (lambda: program,), ddq, ddq_error, tuple(claims))

    def _motion_claims(self, setpoint: Any, ddq: Array, ddq_error: Array) -> list[Claim]:
        """Return what is claimed of the motion: the command, and how many joints move."""
        T, values, v = self.history.description.period_s, np.array(setpoint["values"]), self._v
        sent, off = ddq, ddq_error
        if self._positions:
            sent = self._q + (T * v + 0.5 * T**2 * ddq)
            off = 4.0 * np.spacing(np.abs(values)) + T * self._v_error + T**2 * ddq_error
            off += ROUNDING * (T * np.abs(v) + T**2 * np.abs(ddq))
        near = self._v_error + T * ddq_error + RELATIVE * ACTIVE
        return [
            Claim("command", float(setpoint["command"]), float(self._command), 0.0),
            worst("setpoint", values, sent, off),
            active_joints_claim(setpoint, np.abs(v + T * ddq), near),
        ]

    def _lyapunov_claims(self, setpoint: Any, ddq: Array, ddq_error: Array) -> list[Claim]:
        """Return what is claimed of V = ½|q − q_r|², and the status that follows from it."""
        T, e = self.history.description.period_s, self._q - self.target
        v, v_error = self._v, self._v_error
        step = T * v + 0.5 * T**2 * ddq
        off = np.spacing(np.abs(self._q) + np.abs(step)) + RELATIVE * np.abs(step)
        off = (off + T * v_error + 0.5 * T**2 * ddq_error) / T
        V, rate = 0.5 * float(e @ e), float(e @ step) / T
        growth = rate + 0.5 * float(step @ step) / T
        rate_error = float(np.abs(e) @ off)
        growth_error = rate_error + float(np.abs(step) @ off)
        status = int(setpoint["solver_status"])
        near = np.where(status == AT_TARGET, v_error, -v_error)  # to that error, either is true
        resting = bool(((np.abs(e) <= RESTING) & (np.abs(v) <= RESTING + near)).all())
        rises, proven = 0.0 if resting else max(growth, 0.0), AT_TARGET if resting else CERTIFIED
        expected = proven if self.bounds.kind == "viability" else UNCERTIFIED
        return [
            Claim("V", float(setpoint["v"]), V, RELATIVE * V),
            Claim("predicted V rate", float(setpoint["v_rate_predicted"]), rate, rate_error),
            Claim("required V rate", float(setpoint["v_rate_required"]), rises, growth_error),
            Claim("status", status, expected, 0.0),
        ]


def _around(values: Array, error: Array | float) -> Array:
    """Return values (n,), and both ends of what they may be, (3, n)."""
    off = error + ROUNDING * np.abs(values)
    return np.array([values, values - off, values + off])


def _spread(values: Array) -> Array:
    """Return how far the ends are from the values, (3, n), as (n,)."""
    with np.errstate(invalid="ignore"):  # no bounds
        return np.asarray(np.nan_to_num(np.abs(values[1:] - values[0])).max(0))
