"""Compare a controller's session, summaries and events with those that it records on a replay.

This is the only part of `verify` that runs the controller: verdicts follow from the summary that
it computes again, and not from the one in the log.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from typing import Any

from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.machine import in_words
from hoap3.tools.verify.claims import RELATIVE, Claims

NAMES = {number: name for name, number in Event.schema.constants.items() if "REASON" not in name}
EVENTS = {
    *("RESET", "CONDITION_BEGAN", "CONDITION_ENDED"),
    *("OVERWRITTEN", "CHANGED", "TARGET_STALE", "CONTROLLER_FAILED"),
}
"""Events of a controller that follow from its inputs; ROBOT_FOUND is checked without a replay."""

FROM_OUTSIDE = {"targets"}  # of a summary: messages that were refused are not in the log
Summaries = dict[int, dict[str, Any]]


class Records(Recorder):
    """What a controller recorded, in the log or again.

    Attributes:
        sessions: of each engagement.
        summaries: by session of the robot, and by how many answers had been sent.
        counts: how often there is an event or a reset: its name, tick, and what it states.
        tick: of the newest State.
    """

    def __init__(self) -> None:
        self.sessions: list[dict[str, Any]] = []
        self.summaries: dict[tuple[int, int], dict[str, Any]] = {}
        self.counts = Counter[tuple[str, int, str]]()
        self.tick = 0

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Take a record."""
        del stamp
        if kind == Kind.STATE:
            (self.tick,) = State.scalars(payload, "tick")
        elif kind == Kind.EVENT:
            number, tick, detail = Event.scalars(payload, "kind", "tick", "detail")
            if NAMES.get(number) in EVENTS:
                self.counts[f"event: {NAMES[number]}", tick, str(detail)] += 1
        elif kind == Kind.RESET:
            content = json.loads(payload)
            self.counts["reset", int(content["tick"]), json.dumps(content, sort_keys=True)] += 1
        elif kind == Kind.SESSION:
            self.sessions.append(json.loads(payload))
        elif kind == Kind.SUMMARY:
            content = json.loads(payload)
            self.summaries[int(content["session_id"]), int(content["answers"])] = content


def check_repeated(
    log: Log,
    claims: Claims,
    config: str = "",
    say: Callable[[str], None] = lambda _: None,
    *,
    allow_code: bool = False,
) -> tuple[Summaries, str]:
    """Replay the log of a controller, and compare what it records.

    Args:
        log: of a controller.
        claims: takes what was compared, and what could not be.
        config: why the log has no config, "" where it has one.
        say: takes progress.
        allow_code: import what the log names by a dotted path.

    Returns:
        The newest summary of each session, as it follows from the log; without any the reason.
    """
    from hoap3.tools.analysis.replay import replay

    logged, again, whole = Records(), Records(), True
    for kind, stamp, payload in log.records():
        whole = whole and kind != Kind.GAP
        if whole or kind == Kind.SUMMARY:
            logged.record(kind, stamp, payload)
    why = config or ("" if log.from_begin else "the begin of the log is missing")
    try:
        if not why:
            report = replay(log, [], say=say, allow_code=allow_code, repeated=again)
    except Hoap3Error as error:
        why = "" if any("FAILED" in name for name, _, _ in again.counts) else str(error)
        report = None
    if why:
        claims.unverified("summary and events of the controller", 1, why)
        return {}, why
    whole, others = whole and not log.missing, in_words(report.software) if report else ""
    found, old = Claims(), bool(others)
    if report is not None and report.same < report.setpoints:
        others = others or "the replay differs"
    _compare(logged, again, found, whole=whole, old=old)
    if found.false and others:
        for name, count in found.counts.items():
            claims.unverified(name, count.false, others)
    else:
        _compare(logged, again, claims, whole=whole, old=old)
    if report is not None:
        claims.equal("setpoints in the log", logged.tick, float(report.absent), 0.0, 0.0)
        if report.absent:
            return {}, f"{report.absent} setpoints are missing from the log"
    newest = {session: each for (session, _), each in sorted(again.summaries.items())}
    if whole:
        return newest, ""
    known = {
        each["session_id"]: each for key, each in again.summaries.items() if key in logged.summaries
    }
    kept = {session: each for session, each in known.items() if newest[session] is each}
    return kept, "" if kept else "records are missing"


def _compare(logged: Records, again: Records, claims: Claims, *, whole: bool, old: bool) -> None:
    """Compare records; those of another version only as far as they go."""
    for one, other in zip(logged.sessions[: 0 if old else None], again.sessions, strict=False):
        _equal("session of the controller", 0, one, other, claims, old=old)
    for name, tick, text in sorted({*logged.counts, *(() if old else again.counts)}):
        if whole or tick < logged.tick:  # the last tick of a log that ends early may lack some
            counts = logged.counts[name, tick, text], again.counts[name, tick, text]
            claims.equal(name, tick, *counts, 0.0)
    for key in sorted(logged.summaries.keys() | again.summaries.keys()):
        stated, found = logged.summaries.get(key), again.summaries.get(key)
        if stated is None or (found is None and not whole):
            missing = "answers are missing before it" if found is None else "it is not in the log"
            claims.unverified("summary", 1, missing)
        else:
            found = found or {}
            for name in sorted({*stated, *(() if old else found)} - FROM_OUTSIDE):
                value = stated.get(name), found.get(name)
                _equal(f"summary: {name}", logged.tick, *value, claims, old=old)


def _equal(claim: str, tick: int, stated: Any, found: Any, claims: Claims, *, old: bool) -> None:
    """Compare two JSON values, number by number."""
    if (
        isinstance(stated, dict)
        and isinstance(found, dict)
        and (stated.keys() <= found.keys() if old else stated.keys() == found.keys())
    ):
        for name, value in stated.items():
            _equal(claim, tick, value, found[name], claims, old=old)
    elif isinstance(stated, list) and isinstance(found, list) and len(stated) == len(found):
        for one, other in zip(stated, found, strict=True):
            _equal(claim, tick, one, other, claims, old=old)
    elif type(stated) is type(found) is float:
        near = RELATIVE * max(abs(stated), abs(found)) + 1e-12
        claims.equal(claim, tick, stated, found, near)
    else:
        same = type(stated) is type(found) and stated == found
        claims.equal(claim, tick, float(same), 1.0, 0.0)
