"""Whether the logs of a robot and of its controller tell the same story."""

from __future__ import annotations

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.claims import Claims

Messages = dict[tuple[int, int], set[bytes]]


def check_both(robot: Log, controller: Log, claims: Claims) -> None:
    """The robot's description, and what both logs have of a tick, are the same."""
    together = False
    for kind, name in ((Kind.STATE, "State"), (Kind.SETPOINT, "Setpoint")):
        ours, theirs = _messages(robot, kind), _messages(controller, kind)
        shared = [key for key in theirs if key in ours]
        together |= bool(shared)
        if not shared:
            claims.unverified(f"{name} in both logs", len(theirs), "the logs share no tick")
        same = [float(theirs[key] <= ours[key]) for key in shared]
        ticks = [tick for _, tick in shared]
        claims.equal(f"{name} in both logs", ticks, same, [1.0] * len(same), 0.0)
    if together:
        same_robot = robot.description.digest == controller.description.digest
        claims.equal("description in both logs", 0, float(same_robot), 1.0)
    else:
        claims.unverified("description in both logs", 1, "the logs share no tick")


def _messages(log: Log, kind: Kind) -> Messages:
    """The messages of a kind by session and tick."""
    message = State if kind == Kind.STATE else Setpoint
    found: Messages = {}
    for record in log.records():
        if record.kind == kind:
            try:
                key = message.scalars(record.payload, "session_id", "tick")
            except WireError:
                continue
            found.setdefault((key[0], key[1]), set()).add(record.payload)
    return found
