"""Three verdicts on a run: deadlines, task, limits and balance."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from typing import Any

from hoap3.robot_emulator.filters.base import STARTUP_TICKS
from hoap3.tools.analysis.body_findings import BODY_REASONS, body_of, body_reasons, body_words
from hoap3.tools.analysis.deadline_verdict import (
    FAIL,
    NOT_JUDGED,
    PASS,
    judge_counts,
    judge_deadlines,
    unknown_deadlines,
)

LIMIT_REMEDIES = {
    "position": "Keep setpoints inside the joint's range",
    "speed": "Command at most this speed",
    "acceleration": "Change the commanded speed by at most this limit times the period from one "
    "answer to the next, as with a ramp (ramp_s) or the constraint viability",
    "jerk": "Change the commanded acceleration by at most this limit times the period from one "
    "answer to the next, or raise setpoint_jerk_max",
    "torque": "Command at most this torque",
}
"""What to do about a limit that clipped a setpoint, by its name."""

CERTIFIED_SHARE = 0.95
"""Least share of the answers that must be certified, of those that the controller can certify."""

NAMES = {"deadlines": "deadlines", "task": "task", "limits_and_balance": "limits and balance"}
MOST_CONDITIONS = 3  # in words

COUNT_LOST = "count_lost"
NOT_TOLD, NOT_TOLD_BY_ROBOT = "not_told_by_controller", "not_told_by_robot"
NO_TARGET, DAMAGED = "no_target", "damaged"
NOT_REACHED, NOT_CERTIFIED = "not_reached", "not_certified"
NOT_CERTIFIABLE = "not_certifiable"
HELD_BACK, WEAK = "held_back", "torque_limited"
MARGIN, OUTSIDE = "margin_below_zero", "com_outside_support"
REASONS = {
    NOT_TOLD: "no result from the controller",
    NOT_TOLD_BY_ROBOT: "no counts from the robot",
    NO_TARGET: "no task with an error that is judged",
    DAMAGED: "the log lacks the data it needs",
    NOT_REACHED: "error above tolerance at the end",
    NOT_CERTIFIED: f"fewer than {CERTIFIED_SHARE:.0%} of the answers certified",
    NOT_CERTIFIABLE: "for too many answers there was nothing that a certificate could claim",
    HELD_BACK: "the robot clipped a joint at a limit",
    WEAK: "torques were too small to keep the limits",
    MARGIN: "a constraint was violated",
    OUTSIDE: "the centre of mass left the support polygon",
    **BODY_REASONS,
}
"""Why a verdict is `fail` or `not judged`, in words."""
_UNTOLD = {
    NOT_TOLD: "no result from the controller (constraints and balance)",
    NOT_TOLD_BY_ROBOT: "no counts from the robot (joints clipped)",
}
"""Why limits and balance are not judged, in words: each side knows a part of them."""


def judge(
    deadlines: Mapping[str, Any] | None,
    counts: Mapping[str, Any],
    outcome: Mapping[str, Any] | None,
    *,
    expected: bool = False,
    damaged: Collection[str] = (),
) -> dict[str, Any]:
    """Verdicts, and what each rests on.

    Args:
        deadlines: what `judge_deadlines` returns; None where nothing is known.
        counts: of the robot, as its summary and status have them; empty where it reports none.
            `interventions` and `torque_limited` are periods in which it held a joint back, or
            could not keep its limits for lack of torque; `startup_interventions` are those of a
            start-up step, which do not fail. See also `body_findings`.
        outcome: what the controller reported at its end, see `hoap3.remote_controller.outcome`;
            None where that is not known.
        expected: an outcome is required; without one, verdicts fail.
        damaged: sides, "robot" or "controller", whose logs are cut off or damaged. What is not
            known of these is lost, which fails; ticks that are missing were perhaps not in time,
            so the deadlines of such a robot fail or are not judged.

    Returns:
        `verdicts`, `deadlines`, `task` and `limits_and_balance` (docs/start/concepts.md);
        of each of the last three the `reasons`, and all of it as `text`.
    """
    timing = deadlines or unknown_deadlines(NOT_TOLD_BY_ROBOT, REASONS[NOT_TOLD_BY_ROBOT])
    if "robot" in damaged and timing["verdict"] != FAIL:
        timing = unknown_deadlines(DAMAGED, REASONS[DAMAGED])
    task = _task(outcome, damaged)
    limits = _limits(counts, outcome, damaged)
    verdicts = {
        "deadlines": timing["verdict"],
        "task": _verdict(task["reasons"], expected=expected),
        "limits_and_balance": _verdict(limits["reasons"], expected=expected),
    }
    task["text"], limits["text"] = _task_words(task), _limits_words(limits, _missed(counts))
    timing = {key: value for key, value in timing.items() if key != "verdict"}
    return {"verdicts": verdicts, "deadlines": timing, "task": task, "limits_and_balance": limits}


def judge_run(
    figures: Mapping[str, Any],
    counts: Mapping[str, Any],
    outcome: Mapping[str, Any] | None,
    *,
    expected: bool = False,
) -> dict[str, Any]:
    """Return the verdicts of an observed run, as `judge` does.

    Args:
        figures: as of `judge_deadlines`.
        counts: of the robot's own summary; empty where that is lost.
        outcome: as of `judge`.
        expected: answers and an outcome are required; without them, verdicts fail.
    """
    deadlines = unknown_deadlines(COUNT_LOST, "the robot's own count is lost", FAIL)
    if counts:
        deadlines = judge_deadlines(figures, counts.get("misses_to_stop"))
    if expected and deadlines["verdict"] == NOT_JUDGED:
        deadlines["verdict"] = FAIL
    return judge(deadlines, {**counts, **figures}, outcome, expected=expected)


def judge_reported(
    counts: Mapping[str, Any], outcome: Mapping[str, Any] | None, skipped: int | None = None
) -> dict[str, Any]:
    """`judge` what both sides report of themselves, now or in a log; nonsense is not known.

    Args:
        counts: of the robot, as its summary and status have them; empty where it reports none.
        outcome: as of `judge`.
        skipped: ticks skipped while the robot was active; None: as `counts` has them.
    """
    try:
        timing = judge_counts(counts, skipped) if "asked" in counts else None
        return judge(timing, counts, outcome or None)
    except (KeyError, TypeError, ValueError, AttributeError):
        return judge(None, {}, None)


def shown(judged: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Verdicts as the live page shows them."""
    words, verdicts = in_words(judged), judged["verdicts"]
    return {key: {"verdict": verdicts[key], "words": words[key]} for key in NAMES}


def failed(verdicts: Mapping[str, str]) -> bool:
    """Whether a verdict is `fail`; the exit code is 1 then."""
    return FAIL in verdicts.values()


def in_words(judged: Mapping[str, Any]) -> dict[str, str]:
    """What each verdict rests on, in a line.

    Args:
        judged: has the keys that `judge` returns.
    """
    return {key: judged[key]["text"] for key in NAMES}


def _verdict(reasons: list[str], *, expected: bool) -> str:
    unknown = {NO_TARGET, NOT_CERTIFIABLE}
    unknown |= set() if expected else {NOT_TOLD, NOT_TOLD_BY_ROBOT}
    if reasons and unknown.issuperset(reasons):
        return NOT_JUDGED
    return FAIL if reasons else PASS


def _task(outcome: Mapping[str, Any] | None, damaged: Collection[str]) -> dict[str, Any]:
    outcome = outcome or {}
    errors, certifiable = outcome.get("tasks", []), outcome.get("certifiable", 0)
    certified = outcome.get("certified", 0)
    share = certified / certifiable if certifiable else None
    reasons = []
    if any(each["judged"] and not each["within"] for each in errors):
        reasons.append(NOT_REACHED)
    answers = outcome.get("answers", certifiable)
    if share is not None and share < CERTIFIED_SHARE:
        reasons.append(NOT_CERTIFIED)
    elif outcome.get("certifies", certifiable > 0) and certified < CERTIFIED_SHARE * answers:
        reasons.append(NOT_CERTIFIABLE)
    if not outcome:
        reasons.append(DAMAGED if "controller" in damaged else NOT_TOLD)
    elif not any(each["judged"] for each in errors):
        reasons.append(NO_TARGET)
    return {
        "errors": errors,
        "answers": answers,
        "certifiable": certifiable,
        "certified": certified,
        "certified_share": share,
        "not_certified": dict(outcome.get("not_certified") or {}),
        "reasons": reasons,
    }


def _limits(
    counts: Mapping[str, Any], outcome: Mapping[str, Any] | None, damaged: Collection[str]
) -> dict[str, Any]:
    reported, body = outcome or {}, body_of(counts)
    held_back, torque_limited, at_start = (
        found if isinstance(found := counts.get(name), int) and found >= 0 else None
        for name in ("interventions", "torque_limited", "startup_interventions")
    )
    margin, balance = reported.get("margin") or {}, reported.get("balance") or {}
    least = margin.get("least")
    reasons = [HELD_BACK] if held_back and held_back > (at_start or 0) else []
    reasons += [WEAK] if torque_limited else []
    reasons += body_reasons(body)
    if least is not None and not least >= -margin["tolerance"]:  # NaN is a violation
        reasons.append(MARGIN)
    if balance.get("outside"):
        reasons.append(OUTSIDE)
    silent = {"controller": NOT_TOLD} if outcome is None else {}
    silent |= {"robot": NOT_TOLD_BY_ROBOT} if held_back is None else {}
    if silent:
        reasons += silent.values() if silent.keys().isdisjoint(damaged) else [DAMAGED]
    return {
        "held_back": held_back,
        "startup_interventions": at_start,
        "torque_limited": torque_limited,
        **body,
        "smallest_margin": None if least is None else max(least, -sys.float_info.max),
        "margin_tolerance": margin.get("tolerance"),
        "smallest_margin_of": margin.get("of"),
        "smallest_margin_unit": margin.get("unit"),
        "com_checked": balance.get("checked"),
        "com_outside_support": balance.get("outside"),
        "com_to_edge_m": balance.get("least_m"),
        "reasons": reasons,
    }


def _task_words(task: Mapping[str, Any]) -> str:
    parts = [REASONS[reason] for reason in task["reasons"]]
    parts += [_error_words(each) for each in task["errors"] if each["judged"]]
    if task["certifiable"] or NOT_CERTIFIABLE in task["reasons"]:
        more = task["answers"] - task["certifiable"]
        parts.append(f"certified {task['certified']} of {task['certifiable']} answers")
        parts += [f"{more} more cannot be certified by design"] if more > 0 else []
    elif task["answers"]:
        parts.append(f"none of {task['answers']} answers can be certified by design")
    if NOT_CERTIFIED in task["reasons"] and task["not_certified"]:
        parts.append("not certified: " + ", ".join(list(task["not_certified"])[:MOST_CONDITIONS]))
    others = [f"{_error_words(each)} ({each['note']})" for each in task["errors"] if each["note"]]
    return "; ".join([*parts, *(["not judged: " + ", ".join(others)] if others else [])])


def _missed(counts: Mapping[str, Any]) -> int:
    """How many answers were late or lost, by the counts of a robot or of a run."""
    misses = counts.get("misses")
    if isinstance(misses, Mapping):
        late, lost = misses.get("late"), misses.get("lost")
        return late + lost if isinstance(late, int) and isinstance(lost, int) else 0
    asked, in_time = counts.get("asked"), counts.get("in_time")
    return asked - in_time if isinstance(asked, int) and isinstance(in_time, int) else 0


def _limits_words(limits: Mapping[str, Any], missed: int) -> str:
    parts = [_UNTOLD.get(reason, REASONS[reason]) for reason in limits["reasons"]]
    if limits["held_back"] is not None:
        held = limits["held_back"]
        which = _joint_words(limits.get("held_back_joints"))
        parts.append(f"held back in {held} periods{which}" if held else "no limit held back")
        parts += _startup_words(limits, missed) if held else []
    if limits["torque_limited"]:
        parts.append(f"too little torque in {limits['torque_limited']} periods")
    parts += body_words(limits)
    if limits["smallest_margin"] is not None:
        parts.append(_margin_words(limits))
    if limits["com_to_edge_m"] is not None:
        edge, outside = limits["com_to_edge_m"], limits["com_outside_support"]
        where = "inside" if edge >= 0.0 else "outside"
        share = f", in {outside} of {limits['com_checked']} postures" if outside else ""
        parts.append(f"CoM at worst {_size(abs(edge), 'm')} {where} the edge{share}")
    return "; ".join(parts)


def _startup_words(limits: Mapping[str, Any], missed: int) -> list[str]:
    """State how many clipped periods belong to a start-up step, the limit, and the remedy."""
    words, at_start, found = [], limits.get("startup_interventions"), limits.get("held_back_limit")
    if at_start:
        window = f"the first {STARTUP_TICKS} ticks after a start"
        words.append(f"{at_start} of them in {window}: a start-up step, which does not fail")
    if missed:
        words.append(
            f"missed answers: {missed}; after each the robot holds its last setpoint, which clips "
            "joints that move"
        )
    if found:
        limit, value, unit = found["limit"], found["value"], found["unit"]
        remedy = "First see why answers were missed"
        if not missed:
            remedy = LIMIT_REMEDIES.get(limit, "Ask for less")
        words.append(f"first clipped by the {limit} limit of {value:.4g} {unit}. {remedy}")
    return words


def _margin_words(limits: Mapping[str, Any]) -> str:
    """The smallest margin with its unit, and what it is of, where the controller tells."""
    unit, of = limits.get("smallest_margin_unit"), limits.get("smallest_margin_of")
    words = f"smallest margin {limits['smallest_margin']:.3g}"
    return words + (f" {unit}" if unit else "") + (f" ({of})" if of else "")


def _joint_words(joints: Mapping[str, Any] | None) -> str:
    """Name the joints clipped first and most often; of several in one period the first counts."""
    if not joints:
        return ""
    first = f", first {joints['first']} at tick {joints['first_tick']}"
    most = f"{joints['most']} ({joints['most_periods']} periods)"
    return f"{first}, most often {most}"


def _error_words(error: Mapping[str, Any]) -> str:
    """One task's error beside its tolerance."""
    unit = error["unit"]
    size = "not finite" if error["error"] is None else _size(error["error"], unit)
    kind = "default tolerance" if error.get("default_tolerance") else "tolerance"
    words = f"{error['task']} {size} ({kind} {_size(error['tolerance'], unit)})"
    return f"{words}: {error['reason']}" if error.get("reason") else words


def _size(value: float, unit: str) -> str:
    """A length below 0.1 m in mm, an angle in degrees, a force in N."""
    if unit == "m" and value < 0.1:
        return f"{1e3 * value:.3g} mm"
    return f"{value:.3g} {unit}".rstrip()


def deadline_words(figures: Mapping[str, Any]) -> str | None:
    """Until when an answer was in time; None where that is the start of the next tick."""
    delay, after_receipt = figures.get("delay_ticks", 0), figures.get("deadline") == "after_receipt"
    if not delay and not after_receipt:
        return None
    begin = "the publication of its State" if after_receipt else "the begin of its tick"
    periods = f"{1 + delay} periods" if delay else "a period"
    later = f"; applied {delay} ticks later" if delay else ""
    return f"{periods} after {begin}{later}"
