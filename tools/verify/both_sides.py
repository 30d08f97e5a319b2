"""Compare the logs of a robot and of its controller."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.claims import Claims

UNSHARED = "the logs share no tick of one session; HOAP-3's own protocol carries neither"
Ticks = NDArray[np.int64]


def check_both(robot: Log, controller: Log, claims: Claims) -> None:
    """The robot's description, and what both logs have of a tick, are the same."""
    together = False
    for kind, name in ((Kind.STATE, "State"), (Kind.SETPOINT, "Setpoint")):
        ticks, same = _shared_ticks(robot, controller, kind)
        unread = robot.unreadable[kind] + controller.unreadable[kind]
        claims.unverified(f"{name} in both logs", unread, "cannot be read")
        together |= bool(len(ticks))
        if not len(ticks):
            theirs = controller.table(kind)[1]
            count = len(np.unique([theirs["session_id"], theirs["tick"]], axis=1).T)
            claims.unverified(f"{name} in both logs", count, UNSHARED)
        claims.equal(f"{name} in both logs", ticks, same, np.ones(len(same)), 0.0)
    if not together:
        claims.unverified("description in both logs", 1, UNSHARED)
        return
    try:
        digests = {log.description.digest for log in (robot, controller)}
        claims.equal("description in both logs", 0, float(len(digests) == 1), 1.0)
    except LogError as error:
        claims.unverified("description in both logs", 1, str(error))


def _shared_ticks(robot: Log, controller: Log, kind: Kind) -> tuple[Ticks, NDArray[np.bool_]]:
    """Ticks that both logs have messages of, (M,), and whether the robot's has the controller's."""
    ours, theirs = robot.table(kind)[1], controller.table(kind)[1]
    found, same = [np.zeros(0, np.uint64)], [np.zeros(0, bool)]
    for session in np.intersect1d(ours["session_id"], theirs["session_id"]):
        at, there = (np.flatnonzero(rows["session_id"] == session) for rows in (ours, theirs))
        at = at[np.argsort(ours["tick"][at], kind="stable")]
        ticks, wanted = ours["tick"][at], theirs["tick"][there]
        first, end = (np.searchsorted(ticks, wanted, side) for side in ("left", "right"))
        both = first < end
        there, wanted, first, end = (each[both] for each in (there, wanted, first, end))
        shared = np.unique(wanted)
        alike = np.ones(len(shared), bool)
        pairs = zip(controller.messages(kind, there), robot.messages(kind, at[first]), strict=True)
        off = np.array([own != other for own, other in pairs], bool)
        # several messages of one tick: it may equal another one than the first
        several: dict[int, set[bytes]] = {}
        rest = zip(wanted[off].tolist(), first[off].tolist(), end[off].tolist(), strict=True)
        for message, (tick, begin, stop) in zip(
            controller.messages(kind, there[off]), rest, strict=True
        ):
            if tick not in several:
                several[tick] = set(robot.messages(kind, at[begin:stop]))
            alike[np.searchsorted(shared, tick)] &= message in several[tick]
        found.append(shared)
        same.append(alike)
    return np.concatenate(found).astype(np.int64), np.concatenate(same)


def enclosed_alike(logs: Iterable[Log]) -> dict[str, bool | None]:
    """Whether descriptions and configs agree with the records of these logs, by what was compared.

    None where the other side's log has no record to compare with.

    Args:
        logs: of one run, one a side.
    """
    alike: dict[str, bool | None] = {}
    found = [(log, _stated(log)) for log in logs]
    for log, records in found:
        described = records[Kind.DESCRIPTION][-1:]
        if described and "description.json" not in log.attachments:
            alike[f"description of the {log.side}"] = None
        elif described:
            same = described == [log.attachments.get("description.json")]
            same &= log.attachments.get("robot.urdf", b"").decode(errors="replace") == _urdf(log)
            alike[f"description of the {log.side}"] = same
        for _, theirs in found:
            ours, others = (
                {json.loads(body)["session_id"] for body in each[Kind.SESSION]}
                for each in (records, theirs)
            )
            if theirs is records or not ours & others:
                continue
            known = [json.loads(json.loads(body)["config"]) for body in theirs[Kind.CONFIG]]
            alike[f"config of the {log.side}"] = log.settings in known if known else None
            if described and theirs[Kind.DESCRIPTION]:
                alike["description of both"] = described[0] in theirs[Kind.DESCRIPTION]
    return alike


def _stated(log: Log) -> dict[Kind, list[bytes]]:
    """The records that repeat what a log encloses."""
    found: dict[Kind, list[bytes]] = {Kind.DESCRIPTION: [], Kind.CONFIG: [], Kind.SESSION: []}
    for record in log.records(*found):
        found[record.kind].append(record.payload)
    return found


def _urdf(log: Log) -> str | None:
    try:
        return log.description.urdf
    except LogError:
        return None
