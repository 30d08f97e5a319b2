"""Recount a robot's events from its States, and from the requests that it served.

Between two States stands all that happened in the tick of the second.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from hoap3.protocol.messages import Event, State
from hoap3.tools.verify.claims import Claims

CONSTANTS = Event.schema.constants
NAMES = {number: name for name, number in CONSTANTS.items() if "REASON" not in name}
BY_OBSERVER = {"STALLS_WATCHED", "HOST_STALL"}  # they bear no tick
BY_REQUEST = {
    ("acquire", "granted", True): "GRANTED",
    ("acquire", "granted", False): "REFUSED",
    ("release", "released", True): "RELEASED",
    ("gone", "released", True): "HOLDER_LOST",
    ("recover", "recovered", True): "RECOVERED",
}
MISSES = CONSTANTS["REASON_MISSES"]
SCHEDULE_END = CONSTANTS["REASON_ENDED"]  # may come in the tick of the last miss
CAUSES = {
    CONSTANTS["REASON_RELEASED"]: "RELEASED",
    CONSTANTS["REASON_HOLDER_LOST"]: "HOLDER_LOST",
    CONSTANTS["REASON_COMMAND"]: "stop",
}
REASONS = {number for name, number in CONSTANTS.items() if name.startswith("REASON_")}
WITHOUT_DETAIL = {"STARTED", "ENDED", "RECOVERED"}
RESTS = State.IDLE, State.STOPPED


class RobotEvents:
    """Collects the events between two States, and compares them with both.

    Args:
        misses_to_stop: misses in a row that end in a safe stop; None where it is not known.
        claims: takes what was compared.
    """

    def __init__(self, misses_to_stop: int | None, claims: Claims) -> None:
        self._limit, self._claims = misses_to_stop, claims
        self._mode, self._skipped, self._tick, self._stopped = State.IDLE, 0, 0, 0
        self._events: list[tuple[str, int, int]] = []
        self._served = Counter[str]()
        self._totals = Counter[str]()
        self._limited, self._epochs = False, set[int]()

    def event(self, payload: bytes) -> None:
        """Take an event."""
        kind, tick, detail = Event.scalars(payload, "kind", "tick", "detail")
        name = NAMES.get(kind, str(kind))
        self._limited |= name == "SUPPRESSED"
        self._totals[name] += 1
        if name not in BY_OBSERVER:
            self._events.append((name, tick, detail))

    def request(self, payload: bytes) -> None:
        """Take a request that the robot served."""
        content = json.loads(payload)
        verb, answer = content["verb"], content.get("answer")
        self._limited |= "left_out" in content
        self._served[verb] += 1
        for (asked, key, value), name in BY_REQUEST.items():
            if verb == asked and isinstance(answer, dict) and answer.get(key) is value:
                fresh = name != "GRANTED" or answer["epoch"] not in self._epochs
                self._served[name] += fresh
                self._epochs |= {answer["epoch"]} if name == "GRANTED" else set()

    def state(self, payload: bytes, run: int) -> None:
        """Take the State after them; `run`: misses in a row until then."""
        tick, mode, skipped = State.scalars(payload, "tick", "mode", "skipped")
        moved, counts = self._mode in (State.ACTIVE, State.STOPPING), Counter[str]()
        for name, at, detail in self._events:
            counts[name] += 1
            self._check(name, self._tick <= at <= tick, tick)
            if name in WITHOUT_DETAIL:
                self._check(name, detail == 0, tick)
            if name == "SAFE_STOP":
                self._stopped = at
                cause = CAUSES.get(detail)
                known = self._served[cause] > 0 or self._limited if cause else detail in REASONS
                missed = self._limit is not None and run >= self._limit
                because = missed if detail == MISSES else not missed or detail == SCHEDULE_END
                self._check(name, known and because, tick)
            elif name == "AT_REST":
                self._check(name, detail == at - self._stopped, tick)
            elif name == "SKIPPED":
                self._check(name, detail == skipped - self._skipped, tick)
        self._count("SAFE_STOP", tick, counts, self._mode == State.ACTIVE != mode)
        self._count("AT_REST", tick, counts, moved and mode in RESTS)
        self._count("SKIPPED", tick, counts, skipped > self._skipped)
        for name in () if self._limited else BY_REQUEST.values():
            if counts[name] or self._served[name]:
                self._count(name, tick, counts, self._served[name])
        self._mode, self._skipped, self._tick = mode, skipped, tick
        self._events.clear()
        self._served.clear()

    def end(self, summary: Mapping[str, Any], *, ended: bool) -> None:
        """Check what stands after the last State, and the robot's summary of a log that `ended`."""
        self._count("STARTED", 0, self._totals, 1)
        if not summary:
            self._claims.unverified("summary of the robot", int(ended), "it is not in the log")
            return
        self._count("ENDED", self._tick, self._totals, 1)
        if "rejections" in summary:
            self._count("REJECTED", self._tick, self._totals, len(summary["rejections"]))
        for name, at, detail in self._events:
            self._check(name, at == self._tick and (name != "ENDED" or detail == 0), at)

    def _count(self, name: str, tick: int, counts: Mapping[str, int], found: int) -> None:
        if counts[name] or found:
            self._claims.equal(f"event: {name}", tick, counts[name], found, 0.0)

    def _check(self, name: str, holds: bool, tick: int) -> None:
        self._claims.equal(f"event: {name}", tick, float(holds), 1.0, 0.0)
