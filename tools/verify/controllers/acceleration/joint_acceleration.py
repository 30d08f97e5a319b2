"""`joint_acceleration`: each joint to its target as its bounds allow (Del Prete, RA-L 2018).

q̈ is kp·(q_r − q) − kd·q̇ of (31) and (32), cut to the bounds. A robot that takes positions gets
q + T·q̇ + T²/2·q̈ of the commanded motion. Its position is the applied reference; its velocity is
what the answers before led to, from the reset on, or that of the reference where the robot applied
something else. It is followed here likewise, and damped by the law itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import COMMANDS, schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    complete,
    is_number,
    reason_of,
)
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import posture_of
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.answers import (
    ACTIVE,
    NOT_REMEMBERED,
    check_between,
    check_refused,
)
from hoap3.tools.verify.controllers.acceleration.hierarchy import has_decision

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DEFAULTS: dict[str, Any] = {
    "posture": None,
    "posture_rad": (),
    "kp": 100.0,
    "kd": None,
    "bounds": bounds.DEFAULTS,
}
STATUS = schema("Setpoint").constants
RESTING = 1e-9  # rad and rad/s, or m and m/s: nothing is left to do
ROUNDINGS = 8  # ulp of a position
HELD = 1  # solver_path where a joint is at a bound


@dataclass(frozen=True)
class Motion:
    """Of each answer, from the State before it; all but `known` and `finite` are (N, n).

    Attributes:
        known: whether the log has what the controller remembers, (N,).
        finite: whether the State is, (N,).
        q, dq: where the motion is.
        ddq: what the answer must ask for.
        lower, upper: its bounds.
    """

    known: Flags
    finite: Flags
    q: Array
    dq: Array
    ddq: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Law:
    """(31) and (32) of one robot, within its bounds.

    Attributes:
        positions: whether the robot takes positions.
        target: q_r, (n,).
        kp, kd: gains [1/s², 1/s].
        bounds: of a robot that begins within its ranges.
        T: period [s].
    """

    positions: bool
    target: Array
    kp: float
    kd: float
    bounds: bounds.Bounds
    T: float


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """All that an answer says: the motion itself, V, V̇, margin, path and status."""
    try:
        settings = _settings(parameters, run.description)
    except NOT_READ as error:
        claims.unverified("certificate", len(run.answers), reason_of(error))
        return
    laws = _laws(run, settings)
    motion = _motion(run, laws)
    claims.unverified("certificate", int((~motion.known).sum()), NOT_REMEMBERED)
    check_refused(run.only(motion.known & ~motion.finite), claims)
    judged = motion.known & motion.finite
    at_answers = [id(laws[place]) for place in run.answered.tolist()]
    for law in {id(law): law for law in laws}.values():
        mine = judged & (np.array(at_answers) == id(law))
        if mine.any():
            _check_answers(run.only(mine), _of(motion, mine), law, claims)


def _settings(parameters: Mapping[str, Any], robot: RobotDescription) -> dict[str, Any]:
    """The parameters with their defaults.

    Raises:
        UnverifiableError: parameters, or a robot, that cannot be verified.
    """
    settings = complete(parameters, DEFAULTS, "parameters", strict=False)
    if not {"position", "acceleration"} & {*robot.command_kinds}:
        raise UnverifiableError("the robot takes neither positions nor accelerations")
    if robot.delay_ticks:
        raise UnverifiableError("answers are delayed, and this controller takes no delay")
    target = posture_of(robot, settings["posture"], settings["posture_rad"])
    if target.shape != (robot.n,):
        raise UnverifiableError("the config names no posture of the robot")
    if not (settings["kd"] is None or is_number(settings["kd"])) or settings["kp"] < 0.0:
        raise UnverifiableError(f"gains are {settings['kp']} and {settings['kd']!r:.40}")
    bounds.check_settings(settings["bounds"], robot.n)
    return settings


def _law(robot: RobotDescription, settings: Mapping[str, Any]) -> Law:
    kp, kd = settings["kp"], settings["kd"]
    kind = next(kind for kind in robot.command_kinds if kind != "torque")
    return Law(
        kind == "position",
        posture_of(robot, settings["posture"], settings["posture_rad"]),
        kp,
        2.0 * math.sqrt(kp) if kd is None else kd,
        bounds.Bounds.of(robot, settings["bounds"]),
        robot.period_s,
    )


def _laws(run: ControllerRun, settings: Mapping[str, Any]) -> list[Law]:
    """The law at each State; one object where numbers are the same."""
    if not run.in_force:
        return [_law(run.description, settings)] * len(run.states)
    laws: list[Law] = []
    for i, given in enumerate(run.in_force):
        same = i > 0 and given is run.in_force[i - 1]
        laws.append(laws[-1] if same else _law(run.description, _settings(given, run.description)))
    return laws


def _motion(run: ControllerRun, laws: Sequence[Law]) -> Motion:
    rows = list(_motions(run, laws))
    known, finite = (np.array([row[place] for row in rows], bool) for place in (0, 1))
    return Motion(known, finite, *np.moveaxis(np.array([row[2] for row in rows]), 1, 0))


def _motions(run: ControllerRun, laws: Sequence[Law]) -> Iterator[tuple[bool, bool, Array]]:
    """Row by row: known, finite, and q, q̇, q̈ with its bounds, (5, n)."""
    states, values = run.states, run.answers["values"]
    resets, remembered = np.array([*run.resets, len(states)]), run.remembered
    begun, last, lost = -1, -1, False
    start, limits = states["reference"][0], laws[0].bounds
    limits_of: Law | None = None
    led_to, follows = np.zeros(run.description.n), False
    for i, at in enumerate(run.answered.tolist()):
        reset = int(resets[np.searchsorted(resets, at, "right") - 1])
        if reset != begun:
            begun, lost, follows = reset, False, False
            start, limits_of = states["reference"][reset % len(states)], None
        elif at > last + 1:
            lost = True  # an answer between them, and what it led to, is missing
        law = laws[at]
        if law is not limits_of:
            limits_of, limits = law, law.bounds.begun(start)
        q, v = states["reference" if law.positions else "q"][at], states["dq"][at]
        if law.positions and follows:
            v = led_to
            if (q != values[i - 1]).any():
                ticks = int(states["tick"][at]) - int(states["tick"][last])
                v = (q - states["reference"][last]) / (ticks * law.T)
        finite = bool(np.isfinite(q).all() and np.isfinite(v).all())
        last, follows = at, finite
        with np.errstate(invalid="ignore", over="ignore"):
            lower, upper = limits.at(q, v)
            a = np.clip(-law.kp * (q - law.target) - law.kd * v, lower, upper)
            led_to = v + law.T * a
        yield bool(remembered[i]) and not lost, finite, np.array([q, v, a, lower, upper])


def _of(motion: Motion, rows: Flags) -> Motion:
    return Motion(*(getattr(motion, name)[rows] for name in Motion.__dataclass_fields__))


def _check_answers(run: ControllerRun, motion: Motion, law: Law, claims: Claims) -> None:
    answers, tick, T = run.answers, run.answers["tick"], law.T
    kind = COMMANDS["position" if law.positions else "acceleration"]
    claims.equal("command", tick, answers["command"], np.full(len(tick), kind))
    step = T * motion.dq + 0.5 * T * T * motion.ddq
    last = motion.q + step
    exact = ROUNDINGS * _rounding(motion, law)  # of a position that the motion leads to
    if law.positions:
        claims.equal("setpoint", tick, answers["values"], last, exact)
    else:
        off = RELATIVE * np.maximum(np.abs(motion.ddq), law.bounds.scale)
        claims.equal("setpoint", tick, answers["values"], motion.ddq, off)
    if has_decision(run, run.description.n):
        off = RELATIVE * np.broadcast_to(law.bounds.scale, last.shape)
        claims.equal("decision", tick, answers["decision"], motion.ddq, off)
    speed = np.abs(motion.dq + T * motion.ddq)
    check_between("active joints", tick, answers["active_joints"], speed, ACTIVE, claims)
    for name, wanted in (("rho", 1.0), ("kkt_residual", 0.0), ("fallback", 0.0)):
        claims.equal(name.removeprefix("kkt_"), tick, answers[name], np.full(len(tick), wanted))
    _check_certificate(run, motion, step, exact, law, claims)


def _rounding(motion: Motion, law: Law) -> Array:
    """Unit of the last place of the largest number that adds to a position, (N, n).

    The velocity is followed from cycle to cycle: it has the rounding of the greatest so far.
    """
    size = law.kp * np.abs(motion.q - law.target) + law.kd * np.abs(motion.dq)
    gained = law.T * np.abs(motion.dq).max(0) + 0.5 * law.T**2 * size
    rounding: Array = np.spacing(np.abs(motion.q) + gained)
    return rounding


def _check_certificate(
    run: ControllerRun, motion: Motion, step: Array, exact: Array, law: Law, claims: Claims
) -> None:
    answers, tick, T = run.answers, run.answers["tick"], law.T
    e, v = motion.q - law.target, motion.dq
    claims.equal("V", tick, answers["v"], 0.5 * (e * e).sum(1))
    doubt = (exact + RELATIVE * np.abs(step)) / T
    rate, off = (e * step).sum(1) / T, (np.abs(e) * doubt).sum(1)
    claims.equal("predicted V rate", tick, answers["v_rate_predicted"], rate, off)
    resting = ((np.abs(e) <= RESTING) & (np.abs(v) <= RESTING)).all(1)
    growth = ((e + 0.5 * step) * step).sum(1) / T
    off = off + (np.abs(step) * doubt).sum(1)
    rise = np.where(resting, 0.0, np.maximum(growth, 0.0))
    claims.equal("required V rate", tick, answers["v_rate_required"], rise, off)
    room = np.minimum(motion.ddq - motion.lower, motion.upper - motion.ddq)
    margin = np.minimum(1.0, (room / law.bounds.scale).min(1))
    size = np.maximum(1.0, (np.abs(motion.ddq) / law.bounds.scale).max(1))
    claims.equal("margin", tick, answers["margin"], margin, RELATIVE * size)
    sure = np.abs(margin) > RELATIVE * size
    stated, held = answers["solver_path"], np.where(margin <= 0.0, HELD, 0)
    held = np.where(sure | (stated > HELD), held, stated)
    claims.equal("held by a bound", tick, stated, held, 0.0)
    proven = np.where(resting, STATUS["STATUS_AT_TARGET"], STATUS["STATUS_CERTIFIED"])
    if law.bounds.kind != "viability":
        proven[:] = STATUS["STATUS_UNCERTIFIED"]
    claims.equal("status", tick, answers["solver_status"], proven, 0.0)
