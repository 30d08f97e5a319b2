"""What the robot did: path of its point, positions, Lyapunov function, inputs, active joints.

These are the quantities that section V of the QP12 paper shows, of one session of a log.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hoap3.protocol.errors import DescriptionError, LogError
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.constraints.support.polygon import half_planes
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.tools.analysis.answer_series import (
    UNITS,
    AnswerSeries,
    pair_answers,
    read_answers,
    seconds_since,
)
from hoap3.tools.analysis.certificates import CertificateCount, Certificates, doubts
from hoap3.tools.analysis.report.moments import Moment, moments, range_used
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.analysis.report.targets import find_position_task, target_path
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.logs.log import Log

MOST_POINTS = 20_000  # of the path; more cannot be seen, and each costs a pass of kinematics
NAMES_TASK = {
    **dict.fromkeys(("qp12", "pinv", "osqp"), ("target_m",)),
    **dict.fromkeys(("clik", "clik_sdp"), ("tasks",)),
    "stable_qp": ("task",),
    "tsid": ("tasks", "goal"),
}
"""Controllers that do the robot's default task unless they have one of these parameters."""
STILL_M = 1e-6  # a target that moves less stays where it is
MARGIN_UNITS = dict.fromkeys(("qp12", "pinv", "osqp"), "rad/s")
"""Units of the smallest margin; that of other controllers is its constraint's."""


POSE_BY_DEFAULT = frozenset({"tsid"})
"""Of these the default task is a pose, whose V adds squares of metres and radians."""


@dataclass
class Motion(AnswerSeries):
    """The active part of one session, with its answers.

    Attributes:
        side: whose log tells it; the robot's, unless that holds nothing of it.
        session_id: of the session.
        start_ns: begin of the first tick that asked for an answer; all times count from there.
        first_tick: its number.
        duration_s: from there to the last one.
        joints: names in wire order.
        path_time_s, path_m: (m,) and (m, 3), the point as seen from `frame`.
        frame: that of the task, or the robot's base.
        sole_m: (c, 2), support polygon in that frame, or None, as of a frame's path.
        target_m: (m, 3), target position of the point, NaN where unknown; None without a target.
        v_in_metres: whether V is that of a position alone, in m².
        point: `com`, the centre of mass, or a frame.
        range_used: (m, n), joint positions within their usable range: 0 at its lower end, 1 at its
            upper; nan of joints without limits.
        every: one State of so many is in the path.
        active: (k,), joints with 0.001 rad/s or more.
        certificates: of the answers, or None where no answer has one.
        gaps: what cannot be shown, and why.
        description: of the robot.
        states: how many there are.
        answers: Setpoints in the log: those shown here, and those left out; of those shown, with
            and without a certificate's status.
        moments: those that are shown in space.
    """

    side: str
    session_id: int
    start_ns: int
    first_tick: int
    duration_s: float
    joints: tuple[str, ...]
    path_time_s: FloatArray
    path_m: FloatArray
    frame: str
    sole_m: FloatArray | None
    target_m: FloatArray | None
    v_in_metres: bool
    every: int
    active: FloatArray
    point: str = COM
    range_used: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    certificates: Certificates | None = None
    gaps: list[str] = field(default_factory=list)
    description: RobotDescription | None = None
    states: int = 0
    answers: dict[str, int] = field(default_factory=dict)
    moments: list[Moment] = field(default_factory=list)

    @property
    def target_moves(self) -> bool:
        """Whether the target was at more than one place."""
        known = self.known_target_m
        return len(known) > 0 and bool((np.ptp(known, axis=0) > STILL_M).any())

    @property
    def known_target_m(self) -> FloatArray:
        """(k, 3), `target_m` where it is known; empty without a target."""
        if self.target_m is None:
            return np.empty((0, 3))
        return self.target_m[np.isfinite(self.target_m).all(axis=1)]

    @property
    def has_certificates(self) -> bool:
        """Whether any answer says what V is."""
        return bool(np.isfinite(self.v).any())

    @property
    def requires_decrease(self) -> bool:
        """Whether any answer states that V has to fall at some rate."""
        return bool((self.psi > 0.0).any())

    @property
    def work(self) -> FloatArray:
        """(n,) share of each joint in Σ|u| over all ticks; zeros where nothing moved."""
        each = np.array([np.abs(self.inputs[:, joint]).sum() for joint in range(len(self.joints))])
        total = each.sum()
        return np.asarray(each / total if total > 0.0 else each, float)

    @property
    def limit_room(self) -> FloatArray:
        """(n,) least distance to a limit, % of the usable range; nan of joints without limits."""
        used = 100.0 * self.range_used
        return np.asarray(np.minimum(used, 100.0 - used).min(axis=0, initial=np.inf), float)

    @property
    def nearest_limit(self) -> tuple[str, float] | None:
        """The joint that comes nearest to a limit, and its `limit_room`; None without limits."""
        if not np.isfinite(self.range_used).any():
            return None
        joint = int(np.nanargmin(self.limit_room))
        return self.joints[joint], float(self.limit_room[joint])

    @property
    def edge_m(self) -> FloatArray:
        """(m,) distance of the centre of mass, seen from above, to the nearest edge, inside > 0."""
        if self.sole_m is None:
            return np.empty(0)
        corners = self.sole_m[(self.sole_m != np.roll(self.sole_m, -1, axis=0)).any(axis=1)]
        normals, offsets = half_planes(corners)
        return np.asarray((self.path_m[:, :2] @ normals.T - offsets).min(axis=1), float)


def read_motion(sources: Sources) -> Motion | None:
    """The motion in a log, or None where no State asks for an answer.

    Raises:
        LogError: the log has no valid description, or Pinocchio cannot build the robot.
    """
    for log in sources.logs:
        sent = RowsAt.of(log.setpoints())
        states, setpoints, gaps = _one_session(RowsAt.of(log.states()), sent)
        active = states[states["mode"] == State.ACTIVE]
        if len(active):
            break
    else:
        return None
    description = log.description
    if (joints := active.dtype["q"].shape[0]) != description.n:
        raise LogError(
            f"{log.paths[0]}: its States have {joints} joints, its "
            f"description {description.n}. Name a log that a service of ours has written"
        )
    settings = sources.settings("controller")
    start = int(active["stamp_intended"][0])
    every = -(-len(active) // MOST_POINTS)
    positions = np.asarray(active[::every]["q"], float)
    followed = _follow(sources, active, every, description, gaps)
    rows, answers = _answered(active, setpoints, description.n)
    if len(rows) < len(sent):
        gaps.append(
            f"{len(sent) - len(rows)} of {len(sent)} Setpoints are not in the motion: they are of "
            "another session or length, or answer no State that asked, or one that has an answer."
        )
    if not len(rows):
        gaps.append("Nobody answered: V, Ψ and the control inputs are not known.")
    series = read_answers(rows, answers, description, _parameters(settings), start)
    proved = series.proved
    if len(rows) and not proved.any():
        gaps.append("This controller gives no certificates: V and Ψ are not known.")
    elif not proved.all():
        gaps.append(
            f"{np.count_nonzero(~proved)} of {len(rows)} answers are of a controller that gives no "
            "certificates: V and Ψ are not known there."
        )
    joints_active = answers["active_joints"].astype(float)
    if not proved.all():
        is_speed = series.unit == UNITS[Setpoint.POSITION]
        speeds = series.inputs[~proved] if is_speed else rows[~proved]["dq"]
        joints_active[~proved] = (np.abs(speeds) >= 1e-3).sum(axis=1)
    session_id = int(active["session_id"][0])
    duration_s = (int(active["stamp_intended"][-1]) - start) / 1e9 + description.period_s
    certificates = None
    if proved.any():
        of = slice(None) if proved.all() else proved  # without a copy where all are
        certificates = Certificates(
            tick=series.tick[of],
            time_s=series.time_s[of],
            status=series.status[of],
            rho=series.rho[of],
            margin=series.margin[of],
            duration_s=duration_s,
        )
        certificates = _with_reasons(certificates, sources.controller, session_id)
        gaps += certificates.gaps
    apart = None
    if followed["target_m"] is not None and not followed["v_in_metres"]:
        away = followed["path_m"] - followed["target_m"]
        apart = active[::every], np.linalg.norm(away, axis=1)
    of_margin = MARGIN_UNITS.get(str(settings.get("controller")), "")
    units = "m" if followed["v_in_metres"] else "", of_margin
    return Motion(
        **vars(series),
        side=log.side,
        session_id=session_id,
        start_ns=start,
        first_tick=int(active["tick"][0]),
        duration_s=duration_s,
        joints=description.joint_names,
        path_time_s=seconds_since(start, active[::every]),
        every=every,
        active=joints_active,
        **followed,
        range_used=range_used(positions, description),
        certificates=certificates,
        gaps=gaps,
        description=description,
        states=len(active),
        answers={
            "setpoints": len(sent),
            "shown": len(rows),
            "left_out": len(sent) - len(rows),
            "with_status": int(np.count_nonzero(proved)),
            "without_status": int(np.count_nonzero(~proved)),
        },
        moments=moments(active, rows, series.v, series.margin, units, description, apart),
    )


def _follow(
    sources: Sources, active: Any, every: int, description: RobotDescription, gaps: list[str]
) -> dict[str, Any]:
    """Attributes of a Motion: the shown point, its path, sole and target; gaps are added."""
    settings, log = sources.settings("controller"), sources.controller
    parameters = _parameters(settings)
    point, frame, fixed = _goal(settings.get("controller"), parameters, description)
    task = None
    if fixed is None and log is not None:
        task = find_position_task(parameters, description, point, frame)
    if task is not None:
        point, frame = task.point, task.frame
    path = point_path(np.asarray(active[::every]["q"], float), description, point, frame)
    target = None if fixed is None else np.broadcast_to(fixed, path.shape)
    if task is not None and log is not None:
        try:
            target = target_path(task, log, active, every, description)
        except UnverifiableError as error:
            gaps.append(f"The target of {point} cannot be shown: {error}.")
    soles = [np.array(each.polygon, float) for each in description.soles if each.frame == frame]
    sole = soles[0] if soles and point == COM else None
    if sole is None and description.soles and point == COM:
        gaps.append(
            f"The description of {description.name} has no sole in the frame {frame}: there is "
            "no support polygon."
        )
    return {
        "point": point,
        "frame": frame,
        "path_m": path,
        "sole_m": sole,
        "target_m": target,
        "v_in_metres": fixed is not None and str(settings.get("controller")) not in POSE_BY_DEFAULT,
    }


def _parameters(settings: dict[str, Any]) -> dict[str, Any]:
    found = settings.get("parameters")
    return found if isinstance(found, dict) else {}


def _one_session(states: RowsAt, setpoints: RowsAt) -> tuple[RowsAt, RowsAt, list[str]]:
    """Rows of the session with most States; what it says of the others."""
    sessions, counts = np.unique(states["session_id"], return_counts=True)
    if not len(sessions):
        return states, setpoints[:0], []
    chosen = sessions[int(np.argmax(counts))]
    ours = [rows[rows["session_id"] == chosen] for rows in (states, setpoints)]
    gap = (
        f"The log holds {len(sessions)} sessions of the robot; the motion is that of the longest, "
        f"{counts.max()} of {len(states)} States."
    )
    return ours[0], ours[1], [gap] if len(sessions) > 1 else []


def _answered(states: Any, setpoints: Any, n: int) -> tuple[Any, Any]:
    """States that have an answer, and the answers; those with more than n values are of others."""
    if setpoints.dtype["values"].shape[0] > n:
        setpoints = setpoints[np.isnan(setpoints["values"][:, n:]).all(1)]
    of_states, of_answers = pair_answers(states, setpoints)
    return states[of_states], setpoints[of_answers]


def _with_reasons(certificates: Certificates, log: Log | None, session_id: int) -> Certificates:
    """Add why answers have no certificate, or little of one, as far as the controller names it."""
    if log is None or not (certificates.without or any(map(doubts, log.names("conditions")))):
        return certificates
    count = CertificateCount(session_id)
    for record in log.records(Kind.SETPOINT, Kind.EVENT, Kind.SESSION):
        count.add(record)
    return replace(certificates, reasons=(count.figures() or {}).get("reasons", {}))


def _goal(
    controller: object, parameters: dict[str, Any], description: RobotDescription
) -> tuple[str, str, FloatArray | None]:
    """Point, the frame that it is seen from, and its target, or None where that is not known.

    What a config names counts; else the robot's default task, whose target counts only where the
    config leaves it the task.
    """
    target = _target(parameters)
    named = parameters.get("reference_frame")
    if target is not None and named in description.frames:
        point = parameters.get("point", COM)
        return point if point in description.frames else COM, str(named), target
    default = description.default_task
    if default is None:
        return COM, description.base_frame, target
    keys = NAMES_TASK.get(str(controller))
    if keys is None or any(parameters.get(key) for key in keys):
        return default.point, default.reference, target
    try:
        goal = default_goal(description, "parameters")
    except DescriptionError as error:
        raise LogError(f"the robot in the log cannot be built: {error}") from error
    return goal.point, goal.reference, np.array(goal.target_m)


def _target(parameters: dict[str, Any]) -> FloatArray | None:
    target = parameters.get("target_m")
    if not isinstance(target, list) or len(target) != 3:
        return None
    known = all(isinstance(value, int | float) for value in target)
    return np.array(target, float) if known else None


def point_path(q: FloatArray, description: RobotDescription, point: str, frame: str) -> FloatArray:
    """A frame's origin, or with `com` the centre of mass, for each row of q, (m, 3) [m].

    Args:
        q: (m, n) joint positions.
        description: of the robot.
        point, frame: what is seen, and the frame that it is seen from.

    Raises:
        LogError: Pinocchio cannot build the robot.
    """
    from hoap3.remote_controller.problems.oracles.robot_oracle import Robot

    try:
        robot = Robot(description)
    except DescriptionError as error:
        raise LogError(f"the robot in the log cannot be built: {error}") from error
    path = np.empty((len(q), 3))
    for row, place in zip(q, path, strict=True):
        robot.place_only(row)
        place[:] = robot.com_point(frame) if point == COM else robot.pose(point, frame)[0]
    return path
