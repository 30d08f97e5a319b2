"""Compare the logs of a robot and of its controller."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import LogError, WireError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.claims import Claims

UNSHARED = "the logs share no tick of one session; HOAP-3's own protocol carries neither"
Rows = NDArray[np.bytes_]


def check_both(robot: Log, controller: Log, claims: Claims) -> None:
    """The robot's description, and what both logs have of a tick, are the same."""
    together = False
    for kind, name in ((Kind.STATE, "State"), (Kind.SETPOINT, "Setpoint")):
        ours, theirs = (_messages(log, kind) for log in (robot, controller))
        keys = np.unique(_keys(theirs))
        shared = np.intersect1d(_keys(ours), keys)
        together |= bool(len(shared))
        if not len(shared):
            claims.unverified(f"{name} in both logs", len(keys), UNSHARED)
        same = ~np.isin(shared, _keys(np.setdiff1d(theirs, ours)))
        ticks = shared.view(np.int64)[1::2]
        claims.equal(f"{name} in both logs", ticks, same, np.ones(len(same)), 0.0)
    if not together:
        claims.unverified("description in both logs", 1, UNSHARED)
        return
    try:
        digests = {log.description.digest for log in (robot, controller)}
        claims.equal("description in both logs", 0, float(len(digests) == 1), 1.0)
    except LogError as error:
        claims.unverified("description in both logs", 1, str(error))


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


def _messages(log: Log, kind: Kind) -> Rows:
    """Return session, tick and digest of each message, (N,)."""
    message = State if kind == Kind.STATE else Setpoint
    found = bytearray()
    for record in log.records(kind):
        try:
            key = message.scalars(record.payload, "session_id", "tick")
        except WireError:
            continue
        found += struct.pack("=QQ", *key) + blake2b(record.payload, digest_size=16).digest()
    return np.frombuffer(found, "S32")


def _keys(messages: Rows) -> Rows:
    """Session and tick of each, (N,)."""
    return np.ascontiguousarray(messages).view("S16")[::2]
