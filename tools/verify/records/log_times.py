"""Check log times against the stamps in the messages, and what a log states of its session."""

from __future__ import annotations

import json
from array import array
from collections import deque
from typing import Any

import numpy as np

from hoap3.protocol.errors import DescriptionError, LogError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.disk_rows import PART
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.claims import Claims

BY_OBSERVER = {Event.schema.constants[name] for name in ("STALLS_WATCHED", "HOST_STALL")}
"""Events that bear no session."""


def check_log_times(log: Log, compute_time: int | None, claims: Claims) -> None:
    """Log times of messages are those that they state; others lie between the States around them.

    Args:
        log: of either side.
        compute_time: after which a setpoint arrives in virtual time [ns]; None: not known.
        claims: takes what was compared.
    """
    times = _Times(log, compute_time, claims)
    for kind, stamp, payload in log.records():
        times.take(kind, stamp, payload)
    times.end()


class _Times:
    def __init__(self, log: Log, compute_time: int | None, claims: Claims) -> None:
        self._log, self._claims, self._compute_time = log, claims, compute_time
        self._session: dict[str, Any] | None = None
        self._description: bytes | None = None
        self._tick, self._virtual, self._states, self._last = 0, True, 0, 0
        self._found: dict[str, tuple[array[int], array[float]]] = {}
        self._begin()

    def _begin(self) -> None:
        self._lockstep = bool((self._session or {}).get("lockstep"))
        self._slack = 1 if self._lockstep else 2
        self._before = deque[int](maxlen=self._slack)  # log times of the last States
        self._waiting = deque[list[tuple[Kind, int]]]([[]], maxlen=self._slack)
        self._newest = dict[Kind, int]()

    def take(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Check one record."""
        if kind == Kind.GAP:
            self._begin()
        elif kind == Kind.DESCRIPTION:
            self._description = payload
        elif kind == Kind.SESSION:
            self._session = json.loads(payload)
            self._begin()
        elif kind == Kind.STATE:
            self._state(stamp, payload)
        elif kind == Kind.EVENT:
            own, number, of = Event.scalars(payload, "stamp", "kind", "session_id")
            self._equal("Event", stamp, own)
            self._last = stamp
            if self._session is not None and number not in BY_OBSERVER:
                self._of_session(of)
        elif kind == Kind.SETPOINT:
            self._setpoint(stamp, payload)
        else:
            self._bound(kind, stamp)

    def _state(self, stamp: int, payload: bytes) -> None:
        names = "tick", "stamp_published", "stamp_intended", "session_id"
        self._tick, published, intended, session = State.scalars(payload, *names)
        self._states += 1
        self._virtual &= published == intended
        self._last = stamp
        if self._session is not None:
            self._of_session(session)
        if self._lockstep or self._log.side == "robot":
            self._equal("State", stamp, published)
        else:
            self._at_least(Kind.STATE, stamp, self._before[-1] if self._before else stamp)
        if len(self._waiting) == self._slack:
            for kind, then in self._waiting[0]:
                self._at_least(kind, stamp, then)
        self._before.append(stamp)
        self._waiting.append([])

    def _of_session(self, session: int) -> None:
        said = (self._session or {})["session_id"]
        self._note(f"session of the {self._log.side}", float(session != said))

    def _setpoint(self, stamp: int, payload: bytes) -> None:
        received, encoded = Setpoint.scalars(payload, "stamp_received", "stamp_encoded")
        if self._log.side == "controller":
            self._equal("Setpoint", stamp, encoded)
            if self._before:
                self._equal("State", self._before[-1], received)
        elif self._compute_time is not None and self._lockstep:
            self._equal("Setpoint", stamp, encoded + self._compute_time)
        else:
            self._bound(Kind.SETPOINT, stamp)

    def _bound(self, kind: Kind, stamp: int) -> None:
        """Its log time is not before the last of its kind, and between those of States around."""
        earliest = self._before[0] if len(self._before) == self._slack else stamp
        self._at_least(kind, stamp, max(earliest, self._newest.get(kind, earliest)))
        self._newest[kind] = stamp
        self._waiting[-1].append((kind, stamp))

    def _equal(self, name: str, stamp: int, found: int) -> None:
        self._note(f"log time of {name}", stamp - found)

    def _at_least(self, kind: Kind, stamp: int, bound: int) -> None:
        self._note(f"log time of {kind.name.capitalize()}", max(0, bound - stamp))

    def _note(self, claim: str, off: float) -> None:
        ticks, offs = self._found.setdefault(claim, (array("q"), array("d")))
        ticks.append(self._tick)
        offs.append(off)
        if len(ticks) == PART:
            self._compare(claim)

    def _compare(self, claim: str) -> None:
        ticks, offs = self._found.pop(claim)
        self._claims.equal(claim, np.array(ticks), np.array(offs), np.zeros(len(offs)), 0.0)

    def end(self) -> None:
        """Check the session and the description that the log has beside its messages."""
        side, said, claims = self._log.side, self._session, self._claims
        if self._lockstep:  # time ends with the last State, or event
            for kind, stamp in self._waiting[-1]:
                self._at_least(kind, self._last, stamp)
        for claim in [*self._found]:
            self._compare(claim)
        if not self._states:
            return
        if said is None:
            claims.unverified(f"session of the {side}", 1, "it is not in the log")
        else:
            virtual = said.get("lockstep") if self._over_tcp() else self._virtual
            stated, found = (said.get("side"), said.get("lockstep")), (side, virtual)
            claims.equal(f"session of the {side}", self._tick, stated == found, True, 0.0)
        name = f"description of the {side}"
        try:
            _ = self._log.description
            if self._description is None:
                claims.unverified(name, 1, "it is not among the inputs")
            else:
                RobotDescription.from_json(self._description)
        except (LogError, DescriptionError) as error:
            claims.unverified(name, 1, str(error))

    def _over_tcp(self) -> bool:
        """Whether the States came over HOAP-3's TCP, which carries none of the robot's stamps."""
        link = (self._log.settings or {}).get("link")
        return isinstance(link, dict) and link.get("kind") == "hoap3_tcp"
