"""A stranger without rights that floods a running robot with messages, in a process of its own."""

from __future__ import annotations

import itertools
import json
import secrets
import sys
import time
from typing import Any

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError
from hoap3.protocol.link.zenoh_session import key, open_session
from hoap3.protocol.messages import Setpoint, Target
from hoap3.tools.machine.processes import Lifeline, read_order

PATIENCE_S = 60.0  # for a robot that starts
PACE_S = 0.001  # between two handfuls
MOST_AT_ONCE = 1000  # messages of a handful: what the machine was too slow for is not made up
JOINTS = 6  # of the robot that is raced


def payloads() -> list[tuple[str, bytes]]:
    """Keys below the robot's and what is sent there: whole messages of another run, and none."""
    who = f"stranger-{secrets.token_hex(4)}"
    setpoint, target = Setpoint(JOINTS, 8), Target(1, 3)
    setpoint.session_id = target.session_id = secrets.randbits(63)
    noise = secrets.token_bytes(500)
    return [
        (f"setpoint/{who}", setpoint.dump()),
        (f"setpoint/{who}", noise),
        (f"targets/{who}", target.dump()),
        (f"targets/{who}", noise),
    ]


def connected(endpoint: str, lifeline: Lifeline) -> Any:
    """A session with the robot, as soon as it listens; None where that is no longer wanted.

    Raises:
        LinkError: it never does.
    """
    until = time.monotonic() + PATIENCE_S
    while not lifeline.cut():
        try:
            return open_session(LinkSettings(mode="client", connect=(endpoint,)))
        except LinkError:
            if time.monotonic() > until:
                raise
    return None


def flood(order: dict[str, Any], lifeline: Lifeline) -> int:
    """Send so many messages a second, until the lifeline is cut; how many there were."""
    session = connected(order["endpoint"], lifeline)
    if session is None:
        return 0
    known = [(key(order["robot"], leaf), payload) for leaf, payload in payloads()]
    publishers = {name: session.declare_publisher(name) for name, _ in known}
    turns = itertools.cycle([(publishers[name], payload) for name, payload in known])
    sent, due = 0, 0.0
    last = time.monotonic()
    while not lifeline.cut():
        time.sleep(PACE_S)
        now = time.monotonic()
        due = min(due + (now - last) * order["rate_hz"], MOST_AT_ONCE)
        last = now
        for publisher, payload in itertools.islice(turns, int(due)):
            publisher.put(payload)
            sent += 1
        due -= int(due)
    session.close()
    return sent


def main() -> int:
    """Flood until the lifeline is cut; how much it was goes to standard output as JSON."""
    lifeline, order = Lifeline(), read_order()
    print("ready", flush=True)
    figures: dict[str, Any] = {"messages": 0, "failed": []}
    try:
        figures["messages"] = flood(order, lifeline)
    except LinkError as error:
        figures["failed"].append(str(error))
    json.dump(figures, sys.stdout)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
