"""Runs in lockstep, and their logs written anew with one thing changed and right checksums."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from support.command_bench import inside

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.verify.verify import Verification, verify

Change = Callable[[list[Record]], list[Record]]
STATE, SETPOINT = Kind.STATE, Kind.SETPOINT
WRITERS_OWN = {"log", "clock", "end"}


def ran(folder: Path, *words: object, sets: Iterable[str] = (), seconds: float = 0.1) -> Path:
    """A run in lockstep with these settings."""
    given = [word for each in sets for word in ("--set", each)]
    done = inside("run", "--lockstep", "--duration", seconds, "--out", folder, *words, *given)
    assert done.code in {0, 1}, done.stderr
    return folder


def assert_no_false_alarm(run: Path, verdict: str = "true") -> Verification:
    """Nothing in the logs is false; returns what is found."""
    found = verify(run)
    assert found.claims.by_tick() == []
    assert found.verdict == verdict
    return found


def find_change(change: Change, run: Path, side: str, number: int, folder: Path) -> bool:
    """Assert that a change is found, the first named tick being that of it, or beside it.

    Returns False without a look where it moves nothing, as of a zero.
    """
    before: list[Record] = list(Log.open(run, side=side).records())
    if change(list(before)) == before:
        return False
    found = verify(rewrite(run, side, folder, change)).claims
    assert found.false, number
    first = min(one.tick for one in found.by_tick())
    assert abs(first - number) <= 1, (number, found.by_tick()[:5])
    shutil.rmtree(folder)
    return True


def rewrite(
    run: Path,
    side: str,
    out: Path,
    change: Change,
    config: bytes | None = None,
    enclosed: Mapping[str, bytes] | None = None,
) -> Path:
    """The log of one side with its records changed, and perhaps its config, or what it encloses."""
    log = Log.open(run, side=side)
    given = {"config.yaml": config} if config else {}
    attachments = {**log.attachments, **given, **(enclosed or {})}
    facts = {name: group for name, group in log.metadata.items() if name not in WRITERS_OWN}
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{side}.mcap"
    given = {"attachments": attachments, "metadata": facts}
    with LogWriter(path, robot=log.robot, side=side, **given) as writer:
        for record in change(list(log.records())):
            writer.add(record)
    return path


def config_of(run: Path) -> str:
    """The controller's config in its log."""
    return Log.open(run, side="controller").config


def bigger(value: float) -> float:
    """By the least that must be found."""
    return value * (1.0 + 1e-6)


def dropped(records: list[Record]) -> list[Record]:
    """21 records in the middle were not written, and the log says so."""
    at = len(records) // 2
    gap = Record(Kind.GAP, records[at].stamp, b'{"dropped": 21, "damaged_bytes": 0}')
    return [*records[:at], gap, *records[at + 21 :]]


def nth(records: list[Record], kind: Kind, number: int) -> int:
    """Where the record of a kind stands that has so many of the kind before it."""
    places = [place for place, record in enumerate(records) if record.kind == kind]
    return places[number]


def changed_field(
    kind: Kind, number: int, field: str, to: Callable[[float], float], joint: int | None = None
) -> Change:
    """One field of one message becomes another."""

    def change(records: list[Record]) -> list[Record]:
        place = nth(records, kind, number)
        payload = records[place].payload
        message_type = State if kind == Kind.STATE else Setpoint
        message = message_type.allocate(**message_type.schema.lengths_in(payload))
        message.load(payload)
        if joint is None:
            setattr(message, field, to(getattr(message, field)))
        else:
            values = getattr(message, field)
            values[joint] = to(values[joint])
        records[place] = records[place]._replace(payload=message.dump())
        return records

    return change


def changed_limit(joint: int, key: str, by: float = 1e-6) -> Change:
    """A limit of a joint in the description becomes less by so much of it."""

    def change(records: list[Record]) -> list[Record]:
        place = nth(records, Kind.DESCRIPTION, 0)
        description = json.loads(records[place].payload)
        description["joints"][joint][key] *= 1.0 - by  # stays within what is allowed
        payload = json.dumps(description).encode()
        records[place] = records[place]._replace(payload=payload)
        return records

    return change


def changed_summary(*path: str | int, to: Callable[[Any], Any]) -> Change:
    """A number of the last summary becomes another."""

    def change(records: list[Record]) -> list[Record]:
        place = max(n for n, record in enumerate(records) if record.kind == Kind.SUMMARY)
        summary = json.loads(records[place].payload)
        inner = summary
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = to(inner[path[-1]])
        records[place] = records[place]._replace(payload=json.dumps(summary).encode())
        return records

    return change


ANSWERS: dict[str, Callable[[int], Change]] = {
    "q": lambda n: changed_field(STATE, n, "q", bigger, joint=3),
    "setpoint": lambda n: changed_field(SETPOINT, n, "values", bigger, joint=4),
    "decision": lambda n: changed_field(SETPOINT, n, "decision", bigger, joint=4),
    "V": lambda n: changed_field(SETPOINT, n, "v", bigger),
    "V rate": lambda n: changed_field(SETPOINT, n, "v_rate_predicted", bigger),
    "required V rate": lambda n: changed_field(
        SETPOINT, n, "v_rate_required", lambda rate: bigger(rate) or 1e-6
    ),
    "rho": lambda n: changed_field(SETPOINT, n, "rho", lambda rho: rho * (1 - 1e-6) or 1e-6),
    "margin": lambda n: changed_field(SETPOINT, n, "margin", lambda m: bigger(m) + 1e-12),
    "residual": lambda n: changed_field(SETPOINT, n, "kkt_residual", lambda r: r + 1e-5),
}
"""Changes of what every controller answers, each at the nth answer or State."""


def removed(kind: Kind, number: int) -> Change:
    """One message is not there."""

    def change(records: list[Record]) -> list[Record]:
        del records[nth(records, kind, number)]
        return records

    return change


def swapped(kind: Kind, number: int) -> Change:
    """One message and the next of its kind change places; their log times stay."""

    def change(records: list[Record]) -> list[Record]:
        one, other = nth(records, kind, number), nth(records, kind, number + 1)
        first, second = records[one].payload, records[other].payload
        records[one] = records[one]._replace(payload=second)
        records[other] = records[other]._replace(payload=first)
        return records

    return change
