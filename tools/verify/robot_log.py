"""What a robot's log claims of itself: its schedule, counts and body, and whom it follows."""

from __future__ import annotations

import json
import math
from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Event, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.disk_rows import PART, DiskRows, parts
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.applied_motion import check_held_back, check_motion
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import as_table
from hoap3.tools.verify.deadline_checker import COUNTED, Recount
from hoap3.tools.verify.records.robot_events import RobotEvents

Array = NDArray[np.float64]
EVENTS = Event.schema.constants
FAILURES = EVENTS["REASON_MISSES"], EVENTS["REASON_HOLDER_LOST"]
SUMMED = ("asked", "in_time", "longest_run")

STOPS = {"rad": math.radians(0.5), "m": 1e-3}
"""How far beyond its stops a joint counts, as docs/start/concepts.md has it."""

FALLEN_DEG = 45.0
ANGLE = 1e-5  # degrees: acos next to 1 has half the digits


def check_robot(log: Log, misses_to_stop: int | None, claims: Claims, *, hold: bool) -> None:
    """Everything that can be recounted from a robot's own log.

    Args:
        log: of the robot, written by itself.
        misses_to_stop: misses in a row that end in a safe stop; None where nobody says.
        claims: takes what was compared.
        hold: whether the robot keeps to the last setpoint where one is missing.

    Raises:
        LogError: a record that cannot be read.
    """
    if "recorded" in log.metadata.get("run", {}):
        claims.unverified("deadlines", 1, "recorded from outside: arrivals are not the robot's")
        return
    if not log.from_begin:
        claims.unverified("deadlines", 1, "the begin of the log is missing")
        return
    try:
        recount = Recount(log.description)
    except LogError as error:
        claims.unverified("deadlines", 1, f"no description: {error}")
        return
    stamps, epochs, states = array("q"), array("q"), DiskRows()
    events, whole = RobotEvents(misses_to_stop, claims), True
    summary: dict[str, Any] = {}
    epoch = stops = 0
    for kind, stamp, payload in log.records():
        if kind == Kind.GAP:
            claims.unverified("deadlines", 1, "records are missing; none after them is looked at")
            whole = False
            break
        if kind == Kind.SETPOINT:
            recount.setpoint(stamp, payload)
        elif kind == Kind.STATE:
            recount.state(payload)
            events.state(payload, recount.run)
            _check_counts(recount, misses_to_stop, claims, least=PART)
            states.add(payload)
            stamps.append(stamp)
            epochs.append(epoch)
        elif kind == Kind.EVENT:
            events.event(payload)
            event, detail = Event.scalars(payload, "kind", "detail")
            epoch = detail if event == EVENTS["GRANTED"] else epoch
            stops += event == EVENTS["SAFE_STOP"] and detail in FAILURES
        elif kind == Kind.REQUEST:
            events.request(payload)
        elif kind == Kind.SUMMARY:
            summary = json.loads(payload)
            _check_summary(summary, recount, stops, claims)
    if whole:
        events.end(summary, ended=not log.missing)
    if states:
        _check_counts(recount, misses_to_stop, claims)
        table = as_table(State, states)
        logged = np.array(stamps, np.int64), np.array(epochs, np.int64)
        _check_schedule(table, *logged, round(log.description.period_s * 1e9), claims)
        check_motion(table, log.description, claims)
        check_body(summary, table, log.description, claims)
        _check_settings(summary, table, misses_to_stop, claims)
        counts = summary if whole and hold else {}
        check_held_back(counts, table, log.setpoints(), log.description, claims)


def _check_schedule(
    states: NDArray[np.void],
    stamp: NDArray[np.int64],
    granted: NDArray[np.int64],
    period: int,
    claims: Claims,
) -> None:
    """States lie on the absolute schedule, in order, and none is missing but those skipped.

    `stamp` is the log time of each, and `granted` the epoch that was granted before it, (N,).
    """
    tick, epoch, skipped = (states[name].astype(np.int64) for name in ("tick", "epoch", "skipped"))
    intended, actual, published, sent = (
        states[f"stamp_{name}"] for name in ("intended", "actual", "published", "sent_previous")
    )
    mode = states["mode"]
    zero, off = np.zeros(len(tick)), intended - intended[0] - (tick - tick[0]) * period
    claims.equal("schedule", tick, off, zero, 0.0)
    claims.equal("ticks between", tick[1:], np.diff(tick) - 1 - np.diff(skipped), zero[1:], 0.0)
    claims.equal("log stamp", tick, stamp - published, zero, 0.0)
    claims.at_most("intended before actual", tick, (intended - actual).astype(float), 0.0, 0.0)
    claims.at_most("actual before published", tick, (actual - published).astype(float), 0.0, 0.0)
    for before, after, name in (
        (published[:-1], sent[1:], "published before sent"),
        (sent[1:], actual[1:], "sent before the next tick"),
    ):
        claims.at_most(name, tick[1:], (before - after).astype(float), 0.0, 0.0)
    follows = (mode == State.ACTIVE) | (mode == State.STOPPING)
    active = mode == State.ACTIVE
    claims.equal("epoch in force", tick[active], epoch[active], granted[active], 0.0)
    claims.equal("epoch at rest", tick[~follows], epoch[~follows], zero[~follows], 0.0)


def _check_counts(
    recount: Recount, misses_to_stop: int | None, claims: Claims, *, least: int = 1
) -> None:
    """Check the counts of the newest States, if these are so many at least, and forget them."""
    if len(recount.ticks) < least:
        return
    ticks = np.array(recount.ticks)
    stated, found = (
        np.array(counts).reshape(-1, len(COUNTED)) for counts in (recount.stated, recount.found)
    )
    for place, name in enumerate(COUNTED):
        exact = None if name == "success_rate" else 0.0
        claims.equal(f"count of {name}", ticks, stated[:, place], found[:, place], exact)
    if misses_to_stop is None:
        claims.unverified("stop after misses", len(recount.runs) // 2, "no config says when")
    elif recount.runs:
        tick, run = np.array(recount.runs).reshape(-1, 2).T
        claims.at_most("stop after misses", tick, run, misses_to_stop - 1, 0.0)
    for counted in (recount.ticks, recount.stated, recount.found, recount.runs):
        del counted[:]


def _check_summary(summary: dict[str, Any], recount: Recount, stops: int, claims: Claims) -> None:
    tick = max(recount.last_tick, 0)
    for name in SUMMED:
        if name in summary:
            claims.equal(f"summary: {name}", tick, float(summary[name]), getattr(recount, name))
    if "safe_stops" in summary:
        claims.equal("summary: safe_stops", tick, float(summary["safe_stops"]), stops, 0.0)


def _check_settings(
    summary: dict[str, Any], states: NDArray[np.void], misses_to_stop: int | None, claims: Claims
) -> None:
    """Compare ticks skipped while active with the States, and `misses_to_stop` with the config."""
    last = int(states["tick"][-1])
    if "skipped" in summary:
        active = states["mode"] == State.ACTIVE
        between = np.diff(states["skipped"].astype(np.int64))[active[1:] & active[:-1]]
        claims.equal("summary: skipped", last, summary["skipped"], int(between.sum()), 0.0)
    if "misses_to_stop" in summary and misses_to_stop is not None:
        claims.equal(
            "summary: misses_to_stop", last, summary["misses_to_stop"], misses_to_stop, 0.0
        )


def check_body(
    summary: dict[str, Any], states: NDArray[np.void], robot: RobotDescription, claims: Claims
) -> None:
    """Recount `beyond_stops` and `base`, where a robot's summary has them.

    Args:
        summary: of a robot of any version.
        states: all of its States.
        robot: its description.
        claims: takes what was compared.
    """
    if "beyond_stops" in summary:
        _check_stops(summary["beyond_stops"], states, robot, claims)
    if summary.get("base") is not None:
        _check_base(summary["base"], states, claims)


def _check_stops(
    told: dict[str, Any] | None, states: NDArray[np.void], robot: RobotDescription, claims: Claims
) -> None:
    joints = robot.structure.movable
    kinds = [joints[name].kind for name in robot.joint_names]
    slack = np.array([STOPS["m" if kind == "prismatic" else "rad"] for kind in kinds])

    def beyond(q: Array) -> tuple[Array, Array]:
        """By how much, and how many times the slack more than that."""
        by = np.maximum(q - robot.upper_hard, robot.lower_hard - q)
        return by, (by - slack) / slack

    q, last = states["q"], int(states["tick"][-1])
    outside = np.concatenate([(beyond(q[p])[1] > 0.0).any(axis=1) for p in parts(len(q))])
    periods = 0 if told is None else told["periods"]
    claims.equal("summary: beyond_stops", last, float(periods), int(outside.sum()), 0.0)
    if told is None or not outside.any():
        return
    by, share = beyond(q[outside])
    tick = int(states["tick"][outside][0])
    first = robot.joint_names[int(np.argmax(share[0]))]
    claims.equal("summary: first beyond its stops", last, told["first_tick"], tick, 0.0)
    claims.equal("summary: first beyond its stops", last, told["first"] == first, True, 0.0)
    joint = int(np.unravel_index(np.argmax(share), share.shape)[1])
    most = float(by[:, joint].max())
    named = told["furthest"] == robot.joint_names[joint]
    claims.equal("summary: furthest beyond its stops", last, named, True, 0.0)
    claims.equal("summary: furthest beyond its stops", last, told["furthest_by"], most)


def _check_base(told: dict[str, Any], states: NDArray[np.void], claims: Claims) -> None:
    last, base = int(states["tick"][-1]), states["base"]
    place, turned, w = base[:, :3], base[:, 3:6], base[:, 6:7]
    upright = np.tile([0.0, 0.0, 1.0], (len(base), 1))
    across = np.cross(upright, turned)  # the inverse rotation, of a vector
    up = upright + 2.0 * (w * across + np.cross(across, turned))
    tilts = np.degrees(np.arccos(np.clip(up @ up[0], -1.0, 1.0)))
    fallen = np.flatnonzero(tilts > FALLEN_DEG)
    tick = int(states["tick"][fallen[0]]) if fallen.size else -1
    said = -1 if told["fallen_tick"] is None else told["fallen_tick"]
    claims.equal("summary: base tilt", last, told["tilt_deg"], tilts[-1], ANGLE)
    claims.equal("summary: base tilt", last, told["largest_tilt_deg"], tilts.max(), ANGLE)
    claims.equal("summary: base fell", last, said, tick, 0.0)
    for moved, found in zip(told["moved_m"], place[-1] - place[0], strict=True):
        claims.equal("summary: base moved", last, moved, found)
