"""Writes logs as numpy arrays (`.npz`) and as CSV.

Messages are held once, as the bytes that were logged; columns are views of them, and rows of text
are made block by block.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Schema, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.logs.log import Log

BLOCK = 1024  # rows of a CSV that exist as text at a time
PER_JOINT = {"q", "dq", "tau", "reference", "values"}

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class ExportReport:
    """What was written.

    Attributes:
        out: the file.
        count, unit: how many rows, or arrays.
        missing: what the log has lost, in words, or "".
        complete: nothing is missing but what the log's own cap has deleted.
        replaced: an earlier file lay there.
    """

    out: Path
    count: int
    unit: str
    missing: str
    complete: bool
    replaced: bool

    def __str__(self) -> str:
        return f"{self.out}: {self.count} {self.unit}"


def export(
    path: Path, to: Path, side: str = "robot", say: Callable[[str], None] = lambda _: None
) -> ExportReport:
    """Write a log as `to` is named, `*.csv` or `*.npz`; damaged chunks of the log are left out.

    Args:
        path: a log, or the folder of a run, of which `side` chooses the log.
        to: the file; one that is there already is replaced.
        side: "robot" or "controller".
        say: takes what is being done.

    Raises:
        LogError: no log of ours.
        UsageError: another ending, or `to` cannot be written.
    """
    writers = {".csv": (export_csv, "rows"), ".npz": (export_npz, "arrays")}
    if to.suffix not in writers:
        raise UsageError(f"{to}: cannot tell the format. End the name in .csv or .npz")
    write, unit = writers[to.suffix]
    say("reading the log")
    log = Log.open(path, side if path.is_dir() else None)
    replaced = to.is_file()
    count = write(log, to, say)
    complete = not (log.truncated or log.damages)
    return ExportReport(to, count, unit, log.missing, complete, replaced)


def export_npz(log: Log, out: Path, say: Callable[[str], None] = lambda _: None) -> int:
    """One array a field: `state.q`, `setpoint.tick`, `event.kind`, …, in file order.

    `state.log_time` and its like are the monotonic stamps of the log [ns]; `joint_names` names the
    columns of `state.q` and all that have n.

    Returns:
        How many arrays.

    Raises:
        LogError: the log is damaged.
        UsageError: `out` cannot be written.
    """
    arrays: dict[str, Array] = {"joint_names": np.array(_joint_names(log), dtype=np.str_)}
    for kind in (Kind.STATE, Kind.SETPOINT, Kind.EVENT):
        say(f"reading {kind.name.lower()}s")
        stamps, rows = log.table(kind)
        prefix = kind.name.lower()
        arrays[f"{prefix}.log_time"] = stamps
        arrays |= {f"{prefix}.{name}": rows[name] for name in rows.dtype.names or ()}
    try:
        with whole_file(out) as draft, draft.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
    except OSError as error:
        raise _unwritable(out, error) from error
    return len(arrays)


def export_csv(log: Log, out: Path, say: Callable[[str], None] = lambda _: None) -> int:
    """One row a tick: the State, and the first Setpoint that answers it, or empty fields.

    The columns of the Setpoint begin with `setpoint.`; arrays give a column a joint, such as
    `q.left_knee`, or a number. Lines before the header begin with `#` and give the units. Numbers
    are written so that reading them gives the same bits.

    Returns:
        How many rows.

    Raises:
        LogError: the log is damaged.
        UsageError: `out` cannot be written.
    """
    state_stamps, states = log.table(Kind.STATE)
    setpoint_stamps, setpoints = log.table(Kind.SETPOINT)
    first, answers = _join(states, setpoints)
    names = _joint_names(log)
    left = _Table("", state_stamps, states, names, [])
    right = _Table("setpoint.", setpoint_stamps, setpoints, names, log.names("extra"))
    try:
        with whole_file(out) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
            stream.writelines(f"# {line}\n" for line in _legend())
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([*left.header, *right.header])
            for at in range(0, len(first), BLOCK):
                say(f"row {at} of {len(first)}")
                found = answers[at : at + BLOCK]
                ours = left.rows(first[at : at + BLOCK])
                theirs = right.rows(found[found >= 0])
                empty = [""] * len(right.header)
                for row, answer in zip(ours, found, strict=True):
                    writer.writerow([*row, *(next(theirs) if answer >= 0 else empty)])
    except OSError as error:
        raise _unwritable(out, error) from error
    return len(first)


class _Table:
    """Columns of one kind of message: their names, and any rows of them."""

    def __init__(
        self, prefix: str, stamps: Array, rows: Array, joints: list[str], extra: list[str]
    ) -> None:
        self._stamps, self._rows = stamps, rows
        known = {**dict.fromkeys(PER_JOINT, joints), "extra": extra}
        self.header = [f"{prefix}log_time"]
        for name in rows.dtype.names or ():
            shape = rows.dtype[name].shape
            if not shape:
                self.header.append(prefix + name)
                continue
            labels = known.get(name, [])
            places = labels if len(labels) == shape[0] else range(shape[0])
            self.header += [f"{prefix}{name}.{label}" for label in places]

    def rows(self, places: Array) -> Iterator[tuple[Any, ...]]:
        """The rows at `places`, as Python numbers."""
        rows = self._rows[places]
        columns: list[list[Any]] = [self._stamps[places].tolist()]
        for name in rows.dtype.names or ():
            values = rows[name]
            columns += [values.tolist()] if values.ndim == 1 else values.T.tolist()
        return zip(*columns, strict=True)


def _join(states: Array, setpoints: Array) -> tuple[Array, Array]:
    """Place of each tick's first State, and of the first Setpoint that answers it, or -1."""
    sessions = np.concatenate([states["session_id"], setpoints["session_id"]])
    ticks = np.concatenate([states["tick"], setpoints["tick"]])
    pairs = np.stack([sessions, ticks], axis=1)
    _, keys = np.unique(pairs, axis=0, return_inverse=True)
    state_keys, setpoint_keys = np.split(keys.ravel(), [len(states)])
    _, first = np.unique(state_keys, return_index=True)
    first.sort()
    answered, answers = np.unique(setpoint_keys, return_index=True)
    if not answered.size:
        return first, np.full(len(first), -1)
    wanted = state_keys[first]
    place = np.minimum(np.searchsorted(answered, wanted), answered.size - 1)
    return first, np.where(answered[place] == wanted, answers[place], -1)


def _joint_names(log: Log) -> list[str]:
    try:
        return list(log.description.joint_names)
    except LogError:
        return []  # a log that was cut off before its first record has no names


def _legend() -> Iterator[str]:
    """Units and meaning of the columns, as the comments of the `.msg` files give them."""
    yield "log_time: when it was logged, monotonic clock of the writer, ns"
    for prefix, schema in (("", State.schema), ("setpoint.", Setpoint.schema)):
        yield from _comments(prefix, schema)


def _comments(prefix: str, schema: Schema) -> Iterator[str]:
    fields = {*schema.scalars, *schema.arrays}
    for line in schema.text.splitlines():
        declaration, _, comment = line.partition("#")
        words = declaration.split()
        if not words and comment.strip():
            yield comment.strip()
        elif len(words) == 2 and words[1] in fields and comment.strip():
            yield f"{prefix}{words[1]}: {comment.strip()}"


def _unwritable(out: Path, error: OSError) -> UsageError:
    return UsageError(f"{out}: cannot be written ({error.strerror}). Choose another place")
