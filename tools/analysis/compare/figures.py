"""The figures of a comparison, one set for each controller, and what each of them means.

Whatever only a closed loop has is None in an open one; so is what a controller does not report.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray, Setpoint
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.controllers.base import ACTIVE_SPEED, STATUS
from hoap3.tools.analysis.answer_series import UNITS, AnswerSeries, read_answers
from hoap3.tools.analysis.compare.loops import Answers, Rows
from hoap3.tools.analysis.numbers import greatest, least, number
from hoap3.tools.analysis.report.motion import point_path
from hoap3.tools.analysis.verdicts import NAMES, failed, in_words, judge

SETTLED = 0.01  # of the error at the start
LEAST_MARGIN = -1e-6  # what linearised constraints may miss in one period without a finding
Figures = dict[str, Any]
EMPTY = np.empty((0, 0))
ROUNDING = 1e-9  # of a position [rad or m] or speed, that is no violation of a limit
SPEED = UNITS[Setpoint.POSITION]


@dataclass
class Series(AnswerSeries):
    """The answers of one controller, with what they led to.

    Attributes:
        period_s: for how long an answer counts [s].
        position, speed: (k,) joints that the answer sends beyond a limit of the robot; None where
            u is no speed, and only the robot knows.
        com_m: (k, 3) centre of mass of the applied reference, in the robot's base frame, or empty.
        reference: (k, n) applied reference, or empty.
    """

    period_s: float
    position: NDArray[np.int64] | None
    speed: NDArray[np.int64] | None
    com_m: FloatArray = field(default_factory=lambda: EMPTY)
    reference: FloatArray = field(default_factory=lambda: EMPTY)

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def lyapunov(self) -> FloatArray:
        """(k,) V; NaN where there is none, or the value is no V."""
        return np.where((self.v >= 0.0) & (self.v < np.inf), self.v, np.nan)

    @cached_property
    def error(self) -> FloatArray:
        """(k,) √(2V)."""
        return np.asarray(np.sqrt(2.0 * self.lyapunov))

    @cached_property
    def control_effort(self) -> FloatArray:
        """(k,) |u|₁."""
        return np.asarray(np.abs(self.inputs).sum(axis=1))

    @cached_property
    def moving(self) -> NDArray[np.bool_] | None:
        """(k, n) joints with |u| ≥ 0.001 rad/s; None where u is no speed."""
        return np.abs(self.inputs) >= ACTIVE_SPEED if self.unit == SPEED else None

    @cached_property
    def active(self) -> FloatArray | None:
        """(k,) how many they are."""
        return None if self.moving is None else self.moving.sum(axis=1).astype(float)

    @cached_property
    def switched(self) -> FloatArray | None:
        """(k,) joints that became active, or stopped being so, since the answer before."""
        if self.moving is None:
            return None
        changes = (self.moving[1:] != self.moving[:-1]).sum(axis=1)
        return np.concatenate([np.zeros(min(1, len(self))), changes])

    @cached_property
    def unproved(self) -> NDArray[np.bool_]:
        """(k,) answers that should have a certificate that holds, and have none."""
        return np.isin(self.status, (STATUS["uncertified"], STATUS["infeasible"]))


def read_series(answers: Answers, parameters: dict[str, Any]) -> Series:
    """Take from the answers what figures are made of.

    Args:
        answers: of one controller.
        parameters: its own, which say where its setpoints are integrated from.
    """
    description, states, setpoints = answers.description, answers.states, answers.setpoints
    start = int(states["stamp_intended"][:1].sum())
    with np.errstate(invalid="ignore", over="ignore"):  # whatever a log has in its States
        series = read_answers(states, setpoints, description, parameters, start)
        position, speed = _beyond(description, states, setpoints, series)
    moved = answers.closed_loop and len(states) > 0
    reference = np.array(states["reference"]) if moved else EMPTY
    return Series(
        **vars(series),
        period_s=description.period_s,
        position=position,
        speed=speed,
        com_m=point_path(reference, description, COM, description.base_frame) if moved else EMPTY,
        reference=reference,
    )


def _beyond(
    description: RobotDescription, states: Rows, setpoints: Rows, series: AnswerSeries
) -> tuple[NDArray[np.int64] | None, NDArray[np.int64] | None]:
    """(k,) joints beyond a usable position, and beyond their speed; None where u is no speed.

    A joint that starts outside of its usable positions may stay there, but not go further.
    """
    if series.unit != SPEED:
        return None, None
    before, after = states["reference"], setpoints["values"]
    over = after > np.maximum(description.upper, before) + ROUNDING
    under = after < np.minimum(description.lower, before) - ROUNDING
    fast = np.abs(series.inputs) > description.velocity + ROUNDING
    return (over | under).sum(axis=1), fast.sum(axis=1)


@dataclass(frozen=True)
class Word:
    """A figure of the table.

    Attributes:
        key: dotted path in the JSON of a controller.
        name, unit: what people call it; "u" stands for the unit of u.
        meaning: its definition.
    """

    key: str
    name: str
    unit: str
    meaning: str


WORDS = (
    Word("verdicts.deadlines", "deadlines", "", "pass, warn or fail, as for a run."),
    Word("verdicts.task", "task", "", "pass where targets are reached and answers certified."),
    Word(
        "verdicts.limits_and_balance",
        "limits and balance",
        "",
        "pass where no joint was clamped, no constraint was violated, and the centre of mass "
        "stayed above the soles; else fail.",
    ),
    Word("answers", "answers", "", "States that the controller answered, k."),
    Word("success_rate", "answers in time", "", "Share of them by the deadline of their tick."),
    Word("error.start", "error, start", "unit of the task", "√(2V) at the first answer."),
    Word("error.end", "error, end", "unit of the task", "√(2V) at the last answer."),
    Word("error.settled_s", "to 1 % of the start", "s", "Until the error first was that small."),
    Word("error.integral", "∫ error", "unit of the task · s", "T·Σ√(2V)."),
    Word(
        "v_difference",
        "V, largest difference to the first",
        "",
        "Largest |V − V₁| of any answer, V₁ of the first controller, divided by V₁ at the start.",
    ),
    Word("control_effort.l1", "∫ |u|₁", "u·s", "T·Σₖ Σᵢ |uᵢ|: path of all joints together."),
    Word("control_effort.l2", "∫ |u|²", "u²·s", "T·Σₖ Σᵢ uᵢ²."),
    Word("control_effort.max", "max |u|", "u", "Largest |uᵢ| of any joint at any answer."),
    Word("path.com_m", "path of the CoM", "m", "Its length, seen from the robot's base frame."),
    Word("path.joints_rad", "path of the joints", "rad", "Length of the path in joint space."),
    Word("active_joints.mean", "active joints, mean", "", "Joints with |uᵢ| ≥ 0.001 rad/s."),
    Word("active_joints.max", "active joints, most", "", "The most at any answer."),
    Word(
        "switching_per_s", "switching", "1/s", "How often any joint starts or stops being active."
    ),
    Word("violations.position", "beyond a position limit", "", "Setpoints outside the range."),
    Word("violations.speed", "beyond a speed limit", "", "Answers with a joint too fast."),
    Word("violations.margin", "margin below zero", "", "Certificates with a margin < −10⁻⁶."),
    Word("margin_min", "smallest margin", "unit of its constraint", "Of any certificate."),
    Word("certificates.certified", "certified", "", "Answers with a certificate that holds."),
    Word("certificates.at_target", "at target", "", "Nothing was required, or predicted."),
    Word("certificates.uncertified", "uncertified", "", "Answers whose proof does not hold."),
    Word("certificates.infeasible", "infeasible", "", "No admissible input: the robot stays."),
    Word("certificates.none", "no certificate", "", "The controller states none."),
    Word("rho_min", "ρ, least", "", "Least share of the required decrease Ψ."),
    Word(
        "u_difference",
        "u, largest difference to the first",
        "u",
        "Largest difference of any joint's u to the first controller's, at the same State.",
    ),
)


def figures(
    series: Series,
    first: Series,
    *,
    closed_loop: bool,
    success_rate: float | None = None,
    same_task: bool = True,
    judged: Figures | None = None,
) -> Figures:
    """All figures of one controller.

    Args:
        series: what it did.
        first: what the first controller did, which it is compared with.
        closed_loop: whether its answers moved the robot.
        success_rate: share of answers in time.
        same_task: as the first; what could not be compared is None otherwise.
        judged: its verdicts, as `hoap3.tools.analysis.verdicts.judge` gives them; None for none.
    """
    found: Figures = {
        **(judged or judge(None, {}, None)),
        "answers": len(series),
        "success_rate": success_rate,
        "error": _error(series) if closed_loop else _none("start", "end", "settled_s", "integral"),
        "v_difference": _v_difference(series, first) if closed_loop and same_task else None,
        "control_effort": _control_effort(series),
        "unit": series.unit,
        "path": {
            "com_m": _length(series.com_m) if closed_loop else None,
            "joints_rad": _length(series.reference) if closed_loop else None,
        },
        "active_joints": _active(series),
        "switching_per_s": _switching(series),
        "violations": {
            "position": _some(series.position),
            "speed": _some(series.speed),
            "margin": int((series.margin < LEAST_MARGIN).sum()),
        },
        "margin_min": least(series.margin),
        "certificates": {
            name: int((series.status == value).sum()) for name, value in STATUS.items()
        },
        "rho_min": least(series.rho),
        "u_difference": None if closed_loop else _u_difference(series, first),
    }
    if not same_task:
        found["error"]["settled_s"] = None
    return _known(found)


def _some(joints: NDArray[np.int64] | None) -> int | None:
    """In how many answers there are some; None where that is not known."""
    return None if joints is None else int((joints > 0).sum())


def value(found: Figures, key: str) -> Any:
    """The figure at a dotted path."""
    for part in key.split("."):
        found = found[part]
    return found


def cell(found: Figures, key: str) -> str:
    """One figure as text."""
    given: Any = value(found, key)
    return given if isinstance(given, str) else "–" if given is None else number(given)


def findings(label: str, found: Figures) -> list[str]:
    """What is wrong with a controller, in words."""
    verdicts, words = found["verdicts"], in_words(found)
    wrong = [
        f"{label}: {name} {verdicts[key]}: {words[key]}"
        for key, name in NAMES.items()
        if failed({key: verdicts[key]})
    ]
    k = found["answers"]
    counts = {
        "answers are uncertified": found["certificates"]["uncertified"],
        "answers are infeasible": found["certificates"]["infeasible"],
        "setpoints are beyond a usable position": found["violations"]["position"],
        "answers have a joint beyond its speed": found["violations"]["speed"],
        "certificates have a margin below zero": found["violations"]["margin"],
    }
    return wrong + [f"{label}: {n} of {k} {what}" for what, n in counts.items() if n]


def _known(found: Figures) -> Figures:
    """The same with None for what is no number, as a log with nan in its States leads to."""
    return {
        key: _known(each)
        if isinstance(each, dict)
        else None
        if isinstance(each, float) and not math.isfinite(each)
        else each
        for key, each in found.items()
    }


def _none(*keys: str) -> Figures:
    return dict.fromkeys(keys)


def _error(series: Series) -> Figures:
    known = np.isfinite(series.error)
    if not known.any():
        return _none("start", "end", "settled_s", "integral")
    error, time = series.error[known], series.time_s[known]
    small = np.flatnonzero(error <= SETTLED * error[0])
    return {
        "start": float(error[0]),
        "end": float(error[-1]),
        "settled_s": float(time[small[0]]) if len(small) else None,
        "integral": float(series.period_s * error.sum()),
    }


def _v_difference(series: Series, first: Series) -> float | None:
    k = min(len(series), len(first))
    ours, theirs = series.lyapunov[:k], first.lyapunov[:k]
    if not k or not theirs[0] > 0.0:
        return None
    return greatest(np.abs(ours - theirs) / theirs[0])


def _control_effort(series: Series) -> Figures:
    if not len(series):
        return _none("l1", "l2", "max")
    sizes = np.abs(series.inputs)
    return {
        "l1": float(series.period_s * series.control_effort.sum()),
        "l2": float(series.period_s * (sizes**2).sum()),
        "max": float(sizes.max()),
    }


def _length(points: FloatArray) -> float | None:
    """Of the straight lines from each point to the next."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) if len(points) else None


def _active(series: Series) -> Figures:
    if series.active is None or not len(series):
        return _none("mean", "max")
    return {"mean": float(series.active.mean()), "max": int(series.active.max())}


def _switching(series: Series) -> float | None:
    if series.switched is None or not len(series):
        return None
    return float(series.switched.sum() / (len(series) * series.period_s))


def _u_difference(series: Series, first: Series) -> float | None:
    if series.unit != first.unit or not len(series):
        return None
    return greatest(np.abs(series.inputs - first.inputs))
