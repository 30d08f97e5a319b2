"""Count certificates of answers live and in a log, with conditions during those without one."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, FloatArray, Setpoint
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers import certificate
from hoap3.tools.analysis.event_words import named
from hoap3.tools.analysis.numbers import count, least, seconds

STATUS = certificate.STATUS
PROVED = ("certified", "at_target")
NAMES = ("certified", "at_target", "uncertified", "infeasible")
_NAME_OF = {value: name for name, value in STATUS.items()}
_BEGAN, _ENDED = (Event.schema.constants[f"CONDITION_{end}"] for end in ("BEGAN", "ENDED"))
_LIMITS = ("slowed", "held by ")  # begins of conditions that name a limit rather than a failure
_DOUBTS = ("beta below ",)  # begins of those that say how little a certificate is worth
_CERTIFICATE = ("v_rate_required", "v_rate_predicted", "margin", "kkt_residual", "fallback")
_RESIDUAL, _ROUNDING = 1e-9, 1e-9  # of a certified answer
ELSEWHERE = "the reason is in the controller's log"
_MOST = 3  # reasons in the line for people


class CertificateCount:
    """Counts answers by status, and the conditions that held during those without certificate.

    Fed with the log of a controller it knows both; `answer` alone counts only the former.

    Args:
        session_id: of the robot; records of others are left out. None takes all.

    Attributes:
        present: names of the conditions that hold now.
    """

    def __init__(self, session_id: int | None = None) -> None:
        self._session_id = session_id
        self._names: Sequence[str] = ()
        self.present: frozenset[str] = frozenset()
        self._answers: Counter[tuple[int, frozenset[str]]] = Counter()

    def add(self, record: Record) -> None:
        """Take one record of a controller's log."""
        try:
            if record.kind == Kind.SETPOINT:
                setpoint = Setpoint.like(record.payload)
                setpoint.load(record.payload)
                if self._session_id in {None, setpoint.session_id}:
                    status, invalid = certificate.checked_status(setpoint)
                    self.answer(status, self.present | invalid)
            elif record.kind == Kind.EVENT:
                self._add_event(record.payload)
            elif record.kind == Kind.SESSION:
                self._begin(json.loads(record.payload))
        except (WireError, ValueError, RecursionError):
            return  # nothing that a controller of ours has recorded

    def answer(self, status: int, reasons: frozenset[str] | None = None) -> None:
        """Take the status of one answer, and reasons other than the conditions that hold."""
        self._answers[status, self.present if reasons is None else reasons] += 1

    def figures(self) -> dict[str, Any] | None:
        """Counts by status, `without` certificate, and `reasons`; None where nothing was proved.

        `reasons` has for each status without certificate the conditions that held meanwhile, with
        the number of answers, and for each with one only those that say how little it is worth; a
        status that nobody defined is "unknown".
        """
        statuses, reasons = Counter[int](), dict[str, Counter[str]]()
        for (status, present), n in self._answers.items():
            if status == STATUS["none"]:
                continue
            name = _NAME_OF.get(status, "unknown")
            statuses[status] += n
            held = [each for each in sorted(present) if name not in PROVED or doubts(each)]
            reasons.setdefault(name, Counter()).update(dict.fromkeys(held, n))
        if not statuses:
            return None
        named = {name: dict(found.most_common()) for name, found in reasons.items() if found}
        counts, n = count_statuses(statuses), statuses.total()
        without = n - sum(counts[name] for name in PROVED)
        return {"n": n, **counts, "without": without, "reasons": named}

    def _begin(self, session: Any) -> None:
        if isinstance(session, dict) and self._session_id in {None, session.get("session_id")}:
            names = session.get("conditions")
            self._names = [str(name) for name in names] if isinstance(names, list) else []
            self.present = frozenset()

    def _add_event(self, payload: bytes) -> None:
        kind, session, number = Event.scalars(payload, "kind", "session_id", "detail")
        if kind not in {_BEGAN, _ENDED} or self._session_id not in {None, session}:
            return
        name = {named(self._names, number, "condition")}
        self.present = self.present | name if kind == _BEGAN else self.present - name


def count_statuses(statuses: Counter[int]) -> dict[str, int]:
    """Count answers by the name of their status; "unknown" only where there are any of that kind.

    Args:
        statuses: how often each occurs, but for that of controllers that prove nothing.
    """
    found = {name: statuses[STATUS[name]] for name in NAMES}
    unknown = statuses.total() - sum(found.values())
    return {**found, "unknown": unknown} if unknown else found


def reasons_on_wire(status: int, setpoint: bytes) -> frozenset[str]:
    """Why an answer has no certificate, as far as its Setpoint tells; empty where it has one.

    The names of the conditions are known to the controller only, and to its log.
    """
    if status not in {STATUS["uncertified"], STATUS["infeasible"]}:
        return frozenset()
    required, predicted, margin, residual, fallback = Setpoint.scalars(setpoint, *_CERTIFICATE)
    found = [f"fallback {fallback}"] if fallback else []
    if status == STATUS["uncertified"]:
        found += ["margin below zero"] if margin < 0.0 else []
        found += ["residual above 1e-9"] if not residual <= _RESIDUAL else []
        late = not predicted - required <= _ROUNDING * abs(required)
        found += ["V falls too slowly"] if late else []
    return frozenset(found or [ELSEWHERE])


def doubts(condition: str) -> bool:
    """Whether a condition deserves a word even where all is certified."""
    return condition.startswith(_DOUBTS)


class CountingRecorder(Recorder):
    """A recorder that keeps nothing but the count, and the controller's own summary.

    Attributes:
        count: of what was recorded.
        outcome: the last summary; None before the first.
    """

    def __init__(self) -> None:
        self.count = CertificateCount()
        self.outcome: dict[str, Any] | None = None

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Count it."""
        self.count.add(Record(kind, stamp, payload))
        if kind == Kind.SUMMARY:
            self.outcome = json.loads(payload)


def in_a_line(figures: Mapping[str, Any] | None) -> str | None:
    """`0 of 20 answers certified; 20 infeasible: slowed`; None where nothing is to be said.

    That is where every answer is proved, and none of these proofs is worth little. Of the reasons
    those are named that most answers share; that a limit slows the robot is one only where the
    others are too few for all answers.

    Args:
        figures: as `CertificateCount.figures` gives them.
    """
    if not figures:
        return None
    little = Counter[str]()
    for status in PROVED:
        little.update(figures["reasons"].get(status, {}))
    if not figures["without"] and not little:
        return None
    proved = f"{figures['n'] - figures['without']} of {figures['n']} answers certified"
    parts = [", ".join([proved, *(f"{n} with {name}" for name, n in little.most_common(_MOST))])]
    for status in ("uncertified", "infeasible", "unknown"):
        if not figures.get(status):
            continue
        reasons = figures["reasons"].get(status, {})
        failures = [name for name in reasons if not name.startswith(_LIMITS)]
        enough = sum(reasons[name] for name in failures) >= figures[status]
        words = ", ".join((failures if enough else list(reasons))[:_MOST])
        parts.append(f"{figures[status]} {status}" + (f": {words}" if words else ""))
    return "; ".join(parts)


@dataclass(frozen=True)
class Stretch:
    """Answers without certificate, one after the other.

    Attributes:
        answers: how many.
        tick, begin_s: of the State that the first one answers.
        end_s: of the State that the last one answers; times as in `Certificates`.
    """

    answers: int
    tick: int
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Certificates:
    """What the answers of one session prove; those of a controller that proves nothing are out.

    Attributes:
        tick: (k,), of the States that were answered.
        time_s: (k,), when, since the first tick that asked.
        status: (k,), one of `STATUS`; a log may hold other numbers, which prove nothing.
        rho: (k,), ρ.
        margin: (k,), smallest true margin, in the unit of its constraint.
        duration_s: of the motion.
        reasons: by status, conditions that held during answers without certificate, or that say
            how little one is worth, and during how many; as `CertificateCount.figures` has them.
    """

    tick: NDArray[np.uint64]
    time_s: FloatArray
    status: NDArray[np.uint32]
    rho: FloatArray
    margin: FloatArray
    duration_s: float
    reasons: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Answers that could have had one, k."""
        return len(self.status)

    @cached_property
    def counts(self) -> dict[str, int]:
        """Answers by the name of their status; "unknown" where there are any of that kind."""
        return count_statuses(Counter(self.status.tolist()))

    @property
    def without(self) -> int:
        """Answers without certificate."""
        return self.n - sum(self.counts[name] for name in PROVED)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """Where there was none, in order."""
        missing = ~np.isin(self.status, [STATUS[name] for name in PROVED])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
        return tuple(
            Stretch(end - begin, int(self.tick[begin]), *map(float, self.time_s[[begin, end - 1]]))
            for begin, end in edges.reshape(-1, 2).tolist()
        )

    @property
    def longest(self) -> Stretch | None:
        """The stretch with most answers, of several the first; None where all have one."""
        return max(self.stretches, key=lambda stretch: stretch.answers, default=None)

    @property
    def gaps(self) -> list[str]:
        """What the head of the page has to say of it."""
        little = {name: n for status in PROVED for name, n in self.reasons.get(status, {}).items()}
        said = [
            f"In {count(n)} of {count(self.n)} answers a certificate says little: {name}."
            for name, n in little.items()
        ]
        longest = self.longest
        if longest is None:
            return said
        first = self.stretches[0]
        without = (
            f"{count(self.without)} of {count(self.n)} answers came without a certificate, the "
            f"first at tick {first.tick}; the longest stretch has {count(longest.answers)}, from "
            f"{seconds(longest.begin_s)} s on. V and the constraints are not proved there."
        )
        return [without, *said]

    def as_json(self) -> dict[str, Any]:
        """Counts, first and longest stretch, least ρ and margin, as `--json` prints them."""
        longest = self.longest
        return {
            "n": self.n,
            **self.counts,
            "without": self.without,
            "reasons": {status: dict(found) for status, found in self.reasons.items()},
            "stretches": len(self.stretches),
            "first": asdict(self.stretches[0]) if longest else None,
            "longest": asdict(longest) if longest else None,
            "least_rho": least(self.rho),
            "least_margin": least(self.margin),
        }
