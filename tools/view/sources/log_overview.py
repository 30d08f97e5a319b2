"""The whole of a log at a glance: curves, events, worst ticks; found while the page is in use.

It goes through the log once, chunk by chunk, in a thread that lets others have the CPU in between,
and keeps bins and a few ticks: its memory does not grow with the log.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.event_words import in_words, page_event
from hoap3.tools.logs.log import NEVER_OURS, Log
from hoap3.tools.view.picture.frame import shares_of_limits

BINS = 600  # of each curve
WORST = 10  # ticks that are named
EVENTS = 500  # that are named; of more the first
APART_S = 0.05  # between two ticks that are named
LOOK_S = 0.3  # for which it waits where somebody looks for a place
REST = 0.5  # time that others get, as a share of what a chunk took
NEWS_S = 1.0  # until it first tells while it goes on; each time after twice as long as before
_BEGAN, _ENDED = (Event.schema.constants[f"CONDITION_{each}"] for each in ("BEGAN", "ENDED"))
_NONE = Setpoint.schema.constants["STATUS_NONE"]
_CERTIFICATE = ("v", "v_rate_required", "v_rate_predicted", "rho", "margin", "active_joints")


class Overview:
    """Goes through a log.

    Args:
        log: which.
        zero: log time from which seconds count [ns].
        extras: of the controller's own columns the first so many have curves, too.

    Attributes:
        done: whether all of it was seen.
        version: rises where `as_json` says more than before.
    """

    def __init__(self, log: Log, zero: int, extras: int = 0) -> None:
        self._log, self._zero, self._extras = log, zero, extras
        self._begin, self._span = log.begin, max(log.end - log.begin, 1)
        self._curves: dict[str, np.ndarray[Any, Any]] = {}
        self._events: list[dict[str, Any]] = []
        self._worst: list[tuple[float, float, str]] = []  # a heap: µs, time, what
        self._left_out = Counter[str]()
        self._open: dict[int, tuple[float, str]] = {}  # conditions that hold: since [s], name
        self._missed = -1
        self._misses: list[tuple[float, str]] = []
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._waits_s = 0.0  # until when
        self._thread = threading.Thread(target=self._run, name="overview", daemon=True)
        self.done, self.version = False, 0

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End early."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def give_way(self) -> None:
        """Wait for a while: somebody looks for a place, and shall not wait for us."""
        self._waits_s = time.monotonic() + LOOK_S

    def join(self, timeout_s: float) -> bool:
        """Wait until all was seen; whether it was."""
        self._thread.join(timeout_s)
        return self.done

    def as_json(self) -> dict[str, Any]:
        """Curves of [time, least, greatest], events, worst ticks; times in seconds."""
        with self._lock:
            centres = (self._begin - self._zero + (np.arange(BINS) + 0.5) * self._span / BINS) / 1e9
            curves = {}
            for key, (least, most) in self._curves.items():
                known = np.isfinite(least)
                rows = zip(centres[known], least[known], most[known], strict=True)
                curves[key] = [[round(float(t), 6), _short(a), _short(b)] for t, a, b in rows]
            worst = sorted(self._worst, reverse=True)
            slow = [{"at_s": round(at, 6), "label": label} for _, at, label in worst]
            missed = [{"at_s": round(at, 6), "label": label} for at, label in self._misses]
            return {
                "from_s": round((self._log.begin - self._zero) / 1e9, 6),
                "to_s": round((self._log.end - self._zero) / 1e9, 6),
                "events": list(self._events),
                "worst": [*slow, *missed],
                "overview": curves,
                "done": self.done,
            }

    def _run(self) -> None:
        due, pause = time.monotonic() + NEWS_S, NEWS_S
        for chunk in range(self._log.chunks):
            began = time.monotonic()
            records = self._log.chunk(chunk, keep=False)
            with self._lock:
                try:
                    self._take(records)
                except NEVER_OURS:  # of such a chunk there is nothing to show
                    self._open.clear()
                    self._log.unread.add((chunk, None))
            now = time.monotonic()
            if now > due:
                pause *= 2.0  # a page that takes none shall not pile them up
                due = now + pause
                self.version += 1
            if self._closing.wait(REST * (now - began)):
                return
            while (left_s := self._waits_s - time.monotonic()) > 0.0:
                if self._closing.wait(left_s):
                    return
        with self._lock:
            self._note_open_conditions()
            self._note_left_out()
        self.done = True
        self.version += 1

    def _take(self, records: Sequence[Record]) -> None:
        for record in records:
            if record.kind == Kind.EVENT:
                self._event(record)
            elif record.kind in {Kind.SESSION, Kind.GAP}:  # conditions are not known from there on
                self._open.clear()
        for states, stamps in self._rows(records, Kind.STATE):
            joints = (states[name] for name in ("q", "dq", "tau"))
            curves = {
                "misses": (states["late"] + states["lost"]).astype(float),
                "skipped": states["skipped"].astype(float),
                "success_rate": states["success_rate"],
                **shares_of_limits(self._log.description, *joints),
            }
            self._add(curves, stamps)
            self._note_misses(stamps, states)
        for answers, stamps in self._rows(records, Kind.SETPOINT):
            self._take_answers(answers, stamps)

    def _take_answers(self, answers: Any, stamps: Any) -> None:
        certified = answers["solver_status"] != _NONE
        curves = {key: answers[key][certified].astype(float) for key in _CERTIFICATE}
        curves["error"] = np.sqrt(2.0 * np.where(curves["v"] >= 0.0, curves["v"], np.nan))
        self._add(curves, stamps[certified])
        columns = answers["extra"][:, : self._extras].T
        more = {f"extra.{i}": column for i, column in enumerate(columns)}
        more["cycle_us"] = (answers["stamp_encoded"] - answers["stamp_received"]) / 1e3
        self._add(more, stamps)
        if self._log.side != "robot":
            return
        took = (stamps - answers["stamp_state"]) / 1e3
        self._add({"answer_us": took}, stamps)
        if self._log.session.get("lockstep"):  # all answers take the same virtual time
            return
        for place in np.argsort(took)[-WORST:]:
            at = float(stamps[place] - self._zero) / 1e9
            label = f"tick {int(answers['tick'][place])}: answered after {took[place]:.0f} µs"
            self._note_worst(float(took[place]), at, label)

    def _add(self, curves: Mapping[str, Any], stamps: Any) -> None:
        """Add the values of these times to the bins of curves."""
        places = ((stamps - self._begin) * BINS // self._span).astype(np.int64)
        places = np.clip(places, 0, BINS - 1)
        for key, values in curves.items():
            known = np.isfinite(values)
            if not known.any():
                continue
            if key not in self._curves:
                self._curves[key] = np.stack((np.full(BINS, np.inf), np.full(BINS, -np.inf)))
            least, most = self._curves[key]
            np.minimum.at(least, places[known], values[known])
            np.maximum.at(most, places[known], values[known])

    def _note_worst(self, took: float, at: float, label: str) -> None:
        for other in self._worst:
            if abs(other[1] - at) < APART_S:
                if other[0] >= took:
                    return
                self._worst.remove(other)
                heapq.heapify(self._worst)
                break
        heapq.heappush(self._worst, (took, at, label))
        if len(self._worst) > WORST:
            heapq.heappop(self._worst)

    def _note_misses(self, stamps: Any, states: Any) -> None:
        """Where ticks were late, lost or skipped: the first of each group."""
        missed = (states["late"] + states["lost"] + states["skipped"]).astype(np.int64)
        before = np.concatenate(([self._missed if self._missed >= 0 else missed[0]], missed[:-1]))
        for place in np.flatnonzero(missed > before):
            at = float(stamps[place] - self._zero) / 1e9
            if len(self._misses) < WORST and (not self._misses or at > self._misses[-1][0] + 1.0):
                count = int(missed[place] - before[place])
                tick = int(states["tick"][place])
                label = f"tick {tick}: {count} late, lost or skipped just before"
                self._misses.append((at, label))
        self._missed = int(missed[-1])

    def _note_open_conditions(self) -> None:
        """Add an event at the end for each condition whose end is not in the log."""
        end_s = (self._log.end - self._zero) / 1e9
        for since_s, what in self._open.values():
            held = f"since {since_s:.3f} s, for {end_s - since_s:.3f} s, until the end of the log"
            label = f"condition holds: {what}, {held}"
            self._events.append({"at_s": round(end_s, 6), "label": label, "severity": "info"})

    def _note_left_out(self) -> None:
        """Add an event at the end that counts what is not shown."""
        chunks = sum(place is None for _, place in self._log.unread)
        messages = self._left_out["messages"] + len(self._log.unread) - chunks
        counts = {"damaged chunks": chunks, "unreadable messages": messages}
        counts["more events"] = self._left_out["events"]
        said = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
        if said:
            at_s = round((self._log.end - self._zero) / 1e9, 6)
            label = f"not shown of this log: {said}"
            self._events.append({"at_s": at_s, "label": label, "severity": "warning"})

    def _rows(self, records: Sequence[Record], kind: Kind) -> Iterator[tuple[Any, Any]]:
        """All messages of a kind in a chunk, each layout by itself, and their log times [ns]."""
        schema: Any = State.schema if kind == Kind.STATE else Setpoint.schema
        found: dict[tuple[int, ...], list[Record]] = {}
        for record in records:
            if record.kind == kind:
                try:
                    lengths = tuple(schema.lengths_in(record.payload).values())
                except WireError:
                    self._left_out["messages"] += 1
                else:
                    found.setdefault(lengths, []).append(record)
        for lengths, alike in found.items():
            dtype = schema.dtype(dict(zip(schema.arrays, lengths, strict=True)))
            rows = np.frombuffer(b"".join(record.payload for record in alike), dtype)
            yield rows, np.array([record.stamp for record in alike], np.int64)

    def _event(self, record: Record) -> None:
        event = Event()
        try:
            event.load(record.payload)
        except WireError:
            self._left_out["messages"] += 1
            return
        at_s, joints = (record.stamp - self._zero) / 1e9, self._log.description.joint_names
        names = self._log.names("conditions")
        shown = page_event(event, at_s, joints, names)
        if event.kind == _BEGAN:
            self._open[event.detail] = at_s, in_words(_BEGAN, event.detail, (), names)
        elif event.kind == _ENDED and event.detail in self._open:
            shown["label"] += f", after {at_s - self._open.pop(event.detail)[0]:.3f} s"
        if len(self._events) >= EVENTS:
            self._left_out["events"] += 1
        else:
            self._events.append(shown)


def _short(value: float) -> float:
    """To six digits, however small it is."""
    return float(f"{value:.6g}")
