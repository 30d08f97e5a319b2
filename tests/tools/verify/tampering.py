"""Writes a log anew with one thing changed; all checksums of the new file are right."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter

Change = Callable[[list[Record]], list[Record]]
WRITERS_OWN = {"log", "clock", "end"}


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
    attachments = {**log.attachments, **({"config.yaml": config} if config else {})}
    attachments |= enclosed or {}
    facts = {name: group for name, group in log.metadata.items() if name not in WRITERS_OWN}
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{side}.mcap"
    given = {"attachments": attachments, "metadata": facts}
    with LogWriter(path, robot=log.robot, side=side, **given) as writer:
        for record in change(list(log.records())):
            writer.add(record)
    return path


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


def changed_limit(joint: int, key: str) -> Change:
    """A limit of a joint in the description becomes another by 1e-6 of it."""

    def change(records: list[Record]) -> list[Record]:
        place = nth(records, Kind.DESCRIPTION, 0)
        description = json.loads(records[place].payload)
        description["joints"][joint][key] *= 1.0 - 1e-6  # stays within what is allowed
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
