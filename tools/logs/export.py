"""Writes logs as tables (`.csv`, `.parquet`) and as numpy arrays (`.npz`).

Messages are held once, as the bytes that were logged; columns are views of them, and tables are
written block by block. Beside a table lies a JSON file that describes its columns and counts what
the table does not hold.
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import Schema, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.disk_rows import parts
from hoap3.tools.logs.files import whole_file
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.machine import check_extra

PER_JOINT = {"q", "dq", "tau", "reference", "values"}

Array = npt.NDArray[Any]
Say = Callable[[str], None]


@dataclass(frozen=True)
class ExportReport:
    """What was written.

    Attributes:
        out: the file.
        count, unit: how many rows, or arrays.
        held: how many messages of each kind it holds.
        left_out: how many of each other kind the log holds, or could not be read.
        missing: what the log has lost, in words, or "".
        complete: nothing is missing but what the log's own cap has deleted.
        replaced: earlier files that were there.
    """

    out: Path
    count: int
    unit: str
    held: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    missing: str = ""
    complete: bool = True
    replaced: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """All of it."""
        return {**asdict(self), "out": str(self.out)}

    def __str__(self) -> str:
        held = ", ".join(f"{count} {kind}" for kind, count in self.held.items())
        left = ", ".join(f"{count} {kind}" for kind, count in self.left_out.items())
        return f"{self.out}: {self.count} {self.unit}; {held}" + (
            f"; without {left}" if left else ""
        )


def export(path: Path, to: Path, side: str = "robot", say: Say = lambda _: None) -> ExportReport:
    """Write a log as `to` is named; damaged chunks of the log are left out.

    Args:
        path: a log, or the folder of a run, of which `side` chooses the log.
        to: `*.csv`, `*.parquet` or `*.npz`; one that is there already is replaced.
        side: "robot" or "controller".
        say: takes what is being done.

    Raises:
        LogError: no log of ours.
        UsageError: another ending, or `to` cannot be written.
        NotInstalledError: the package for Parquet is missing.
    """
    writers = {".csv": export_csv, ".parquet": export_parquet, ".npz": export_npz}
    if to.suffix not in writers:
        raise UsageError(f"{to}: cannot tell the format. End the name in .csv, .parquet or .npz")
    if to.suffix == ".parquet":
        check_extra("parquet")
    say("reading the log")
    log = Log.open(path, side if path.is_dir() else None)
    arrays = to.suffix == ".npz"
    files = [to] if arrays else [to, to.with_suffix(".json")]
    replaced = tuple(str(file) for file in files if file.is_file())
    count = writers[to.suffix](log, to, say)
    held, left_out = _counts(log, Kind.STATE, Kind.SETPOINT, *([Kind.EVENT] if arrays else []))
    complete = not (log.truncated or log.damages or any(log.unreadable.values()))
    unit = "arrays" if arrays else "rows"
    return ExportReport(to, count, unit, held, left_out, log.missing, complete, replaced)


def export_npz(log: Log, out: Path, say: Say = lambda _: None) -> int:
    """One array a field: `state.q`, `setpoint.tick`, `event.kind`, …, in file order.

    `state.log_time` and its like are the monotonic stamps of the log [ns]; `joint_names` names the
    columns of `state.q` and all that have n.

    Returns:
        How many arrays.

    Raises:
        LogError: the log is damaged.
        UsageError: `out` cannot be written.
    """
    arrays: dict[str, Array] = {"joint_names": np.array(log.joint_names, dtype=np.str_)}
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


def export_csv(log: Log, out: Path, say: Say = lambda _: None) -> int:
    """One row a State, with the Setpoint that answers it; see `_rows`.

    The first line names the columns: those of the Setpoint begin with `setpoint.`; arrays give a
    column a joint, such as `q.left_knee`, or a number. Fields of a message that a row does not
    have are empty. Numbers are written so that reading them gives the same bits.

    Returns:
        How many rows.

    Raises:
        LogError: the log is damaged.
        UsageError: `out` or the JSON file beside it cannot be written.
    """

    def write(draft: Path, tables: tuple[_Table, _Table]) -> None:
        with draft.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(name for table in tables for name in table.columns)
            for blocks in _blocks(tables, say):
                texts = [
                    [
                        "" if none else value
                        for value, none in zip(values.tolist(), absent.tolist(), strict=True)
                    ]
                    for values, absent in blocks
                ]
                writer.writerows(zip(*texts, strict=True))

    return _export(log, out, write)


def export_parquet(log: Log, out: Path, say: Say = lambda _: None) -> int:
    """The same as Parquet: null where a row does not have a message.

    Returns, raises: as `export_csv`.
    """
    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    def write(draft: Path, tables: tuple[_Table, _Table]) -> None:
        columns = {name: dtype for table in tables for name, dtype in table.columns.items()}
        schema = pa.schema([(name, pa.from_numpy_dtype(dtype)) for name, dtype in columns.items()])
        with ParquetWriter(draft, schema) as writer:
            for blocks in _blocks(tables, say):
                arrays = [pa.array(values, mask=absent) for values, absent in blocks]
                writer.write_table(pa.Table.from_arrays(arrays, schema=schema))

    return _export(log, out, write)


def _export(log: Log, out: Path, write: Callable[[Path, tuple[_Table, _Table]], None]) -> int:
    """Write a table, and beside it what describes it; how many rows it has."""
    (state_stamps, states), (stamps, setpoints) = log.table(Kind.STATE), log.table(Kind.SETPOINT)
    first, answers = _rows(state_stamps, states, stamps, setpoints)
    names = list(log.joint_names)
    left = _Table("", state_stamps, states, names, [], first)
    right = _Table("setpoint.", stamps, setpoints, names, log.names("extra"), answers)
    held, left_out = _counts(log, Kind.STATE, Kind.SETPOINT)
    about = {
        "robot": log.robot,
        "side": log.side,
        "sessions": np.unique(states["session_id"]).tolist(),
        "joint_names": names,
        "rows": len(first),
        "rows_without_state": int(np.count_nonzero(first < 0)),
        "rows_without_setpoint": int(np.count_nonzero(answers < 0)),
        "held": held,
        "left_out": left_out,
        "missing": log.missing,
        "notes": [*_notes(State.schema), *_notes(Setpoint.schema)],
        "columns": {**left.about(State.schema), **right.about(Setpoint.schema)},
    }
    try:
        with whole_file(out) as draft:
            write(draft, (left, right))
        with whole_file(out.with_suffix(".json")) as draft:
            draft.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise _unwritable(out, error) from error
    return len(first)


class _Table:
    """Columns of one kind of message: their names, and the rows at some places of it.

    Args:
        prefix: of the names.
        stamps, rows: of the messages.
        joints, extra: names of what arrays hold.
        places: of the message in each row, (R,), -1 for none.
    """

    def __init__(
        self,
        prefix: str,
        stamps: Array,
        rows: Array,
        joints: list[str],
        extra: list[str],
        places: Array,
    ) -> None:
        self._prefix, self._stamps, self._rows, self._places = prefix, stamps, rows, places
        known = {**dict.fromkeys(PER_JOINT, joints), "extra": extra}
        self.columns = {f"{prefix}log_time": np.dtype(np.int64)}
        self._of: dict[str, str] = {}  # whose a column is: a joint's, or a figure of the controller
        for name in rows.dtype.names or ():
            base, shape = rows.dtype[name].base, rows.dtype[name].shape
            labels = known.get(name, [])
            fits = bool(shape) and len(set(labels)) == len(labels) == shape[0]
            ends = labels if fits else [str(i) for i in range(shape[0] if shape else 0)]
            titles = [f"{prefix}{name}.{label}" for label in ends] if shape else [prefix + name]
            self.columns |= dict.fromkeys(titles, base)
            self._of |= dict(zip(titles, ends, strict=False))

    def __len__(self) -> int:
        return len(self._places)

    def block(self, part: slice) -> Iterator[tuple[Array, Array]]:
        """Of each column the values of some rows, and which of them are absent."""
        places = self._places[part]
        absent = places < 0
        if absent.all():
            yield from ((np.zeros(len(places), dtype), absent) for dtype in self.columns.values())
            return
        places = np.where(absent, 0, places)
        yield self._stamps[places], absent
        for name in self._rows.dtype.names or ():
            values = self._rows[name][places]
            yield from ((column, absent) for column in np.atleast_2d(values.T))

    def about(self, schema: Schema) -> dict[str, dict[str, str]]:
        """Type of each column as pandas names it, and what it means, with its unit."""
        gaps, meanings = (self._places < 0).any(), _meanings(schema)
        meanings["log_time"] = "when it was logged, monotonic clock of the writer, ns"
        found = {}
        for title, dtype in self.columns.items():
            name = title.removeprefix(self._prefix).partition(".")[0]
            kind = dtype.name.replace("i", "I", 1).replace("uI", "UI") if gaps else dtype.name
            kind = dtype.name if dtype.kind == "f" else kind
            found[title] = {"dtype": kind, "meaning": meanings.get(name, ""), "field": name}
            if title in self._of:
                found[title]["of"] = self._of[title]
        return found


def _blocks(tables: tuple[_Table, _Table], say: Say) -> Iterator[list[tuple[Array, Array]]]:
    """Of each block of rows the values of all columns, and which of them are absent."""
    for part in parts(len(tables[0])):
        say(f"row {part.start} of {len(tables[0])}")
        yield [each for table in tables for each in table.block(part)]


def _rows(
    state_stamps: Array, states: Array, stamps: Array, setpoints: Array
) -> tuple[Array, Array]:
    """Places of the State and of the Setpoint of each row, -1 for none.

    A State and a Setpoint of one session and tick share a row: the first ones, the second ones
    and so on. Every message has its row; those of Setpoints without a State lie where they were
    logged.
    """
    sessions = np.concatenate([states["session_id"], setpoints["session_id"]])
    ticks = np.concatenate([states["tick"], setpoints["tick"]])
    _, keys = np.unique(np.stack([sessions, ticks], axis=1), axis=0, return_inverse=True)
    ours, theirs = (_numbered(each, len(keys)) for each in np.split(keys.ravel(), [len(states)]))
    _, at, of = np.intersect1d(ours, theirs, assume_unique=True, return_indices=True)
    answers = np.full(len(states), -1)
    answers[at] = of
    alone = np.setdiff1d(np.arange(len(setpoints)), of)
    logged = np.concatenate([np.maximum.accumulate(state_stamps), stamps[alone]])
    order = np.argsort(logged, kind="stable")
    first = np.concatenate([np.arange(len(states)), np.full(len(alone), -1)])
    return first[order], np.concatenate([answers, alone])[order]


def _numbered(keys: Array, most: int) -> Array:
    """Different numbers for equal keys below `most`: the n-th of each key is the same for all."""
    order = np.argsort(keys, kind="stable")
    nth = np.empty_like(order)
    nth[order] = np.arange(len(keys)) - np.searchsorted(keys[order], keys[order])
    return keys + nth * most


def _counts(log: Log, *tables: Kind) -> tuple[dict[str, int], dict[str, int]]:
    """How many messages of each kind these tables hold, and how many others there are."""
    kinds = Counter(record.kind for record in log.records())
    held, left = {}, {}
    for kind in (Kind.STATE, Kind.SETPOINT, Kind.EVENT, Kind.TARGET):
        name, count = f"{kind.name.lower()}s", kinds.pop(kind, 0)
        if kind in tables:
            held[name] = log.held[kind]
            left[f"unreadable {name}"] = count - held[name]
        else:
            left[name] = count
    left["damaged places"] = kinds.pop(Kind.GAP, 0)
    left |= {"inputs": kinds.total(), "messages on other topics": log.others}
    return held, {name: count for name, count in left.items() if count}


def _meanings(schema: Schema) -> dict[str, str]:
    """Units and meaning of the fields, as the comments of the `.msg` file give them."""
    found = {}
    for line in schema.text.splitlines():
        declaration, _, comment = line.partition("#")
        words = declaration.split()
        if len(words) == 2:
            found[words[1]] = comment.strip()
    return found


def _notes(schema: Schema) -> list[str]:
    """What the `.msg` file says of no field."""
    return [line[1:].strip() for line in schema.text.splitlines() if line.startswith("#")]


def _unwritable(out: Path, error: OSError) -> UsageError:
    return UsageError(f"{out}: cannot be written ({error.strerror}). Choose another place")
