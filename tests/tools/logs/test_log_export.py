"""Exports hold the numbers of the log, to the bit."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.log_samples import MS, START, describe, fill, inputs, ticks, write

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.export import export, export_csv, export_npz
from hoap3.tools.logs.log import Log

JOINTS = 3


def read_csv(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Comments, and rows by column."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    return comments, list(csv.DictReader(lines[len(comments) :]))


def test_npz_equals_the_arrays(tmp_path: Path) -> None:
    write(tmp_path, inputs(describe(JOINTS)) + ticks(JOINTS, 200))
    log = Log.open(tmp_path)
    count = export_npz(log, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        assert len(found.files) == count
        assert tuple(found["joint_names"]) == log.description.joint_names
        for kind in (Kind.STATE, Kind.SETPOINT, Kind.EVENT):
            stamps, rows = log.table(kind)
            prefix = kind.name.lower()
            assert np.array_equal(found[f"{prefix}.log_time"], stamps)
            for name in rows.dtype.names or ():
                assert np.array_equal(found[f"{prefix}.{name}"], rows[name])


def test_csv_equals_the_arrays(tmp_path: Path) -> None:
    write(tmp_path, inputs(describe(JOINTS)) + ticks(JOINTS, 2500))  # more than two blocks
    log = Log.open(tmp_path)
    assert export_csv(log, tmp_path / "a.csv") == 2500
    comments, rows = read_csv(tmp_path / "a.csv")
    names = log.description.joint_names
    for prefix, kind in (("", Kind.STATE), ("setpoint.", Kind.SETPOINT)):
        stamps, table = log.table(kind)
        assert [int(row[f"{prefix}log_time"]) for row in rows] == stamps.tolist()
        for name in table.dtype.names or ():
            values = table[name]
            if values.ndim == 1:
                read = int if values.dtype.kind in "iu" else float
                assert [read(row[prefix + name]) for row in rows] == values.tolist()
                continue
            labels = range(2) if name == "extra" else names
            for label, column in zip(labels, values.T, strict=False):
                found = [float(row[f"{prefix}{name}.{label}"]) for row in rows]
                assert found == column.tolist()
    assert f"q.{names[0]}" in rows[0]
    assert "# q: measured positions, rad or m, n" in comments
    assert "# setpoint.rho: share of Psi that is asked for, 0 to 1" in comments


def message(kind: Kind, tick: int, session: int, stamp: int) -> Record:
    sample = State(1) if kind == Kind.STATE else Setpoint(1)
    rng = np.random.default_rng(stamp)
    return Record(kind, stamp, fill(sample, rng, tick=tick, session_id=session))


SENT = st.tuples(
    st.sampled_from([Kind.STATE, Kind.SETPOINT]), st.integers(0, 5), st.sampled_from([7, 1 << 62])
)


@given(sent=st.lists(SENT, max_size=30))
def test_each_tick_is_joined_with_its_first_answer(
    tmp_path_factory: pytest.TempPathFactory, sent: list[tuple[Kind, int, int]]
) -> None:
    """Whatever was lost, repeated, late, or of another session."""
    folder = tmp_path_factory.mktemp("log")
    records = [message(*what, START + place * MS) for place, what in enumerate(sent)]
    write(folder, records)
    first: dict[tuple[Kind, int, int], int] = {}
    for what, record in zip(sent, records, strict=True):
        first.setdefault(what, record.stamp)
    expected = [
        (str(stamp), str(first.get((Kind.SETPOINT, tick, session), "")))
        for (kind, tick, session), stamp in first.items()
        if kind == Kind.STATE
    ]
    assert export_csv(Log.open(folder), folder / "a.csv") == len(expected)
    _, rows = read_csv(folder / "a.csv")
    assert [(row["log_time"], row["setpoint.log_time"]) for row in rows] == expected
    for row in rows:
        answered = row["setpoint.log_time"] != ""
        assert (row["setpoint.tick"] == row["tick"]) == answered
        assert (row["setpoint.v"] != "") == answered


def test_numbers_that_are_not_finite_survive(tmp_path: Path) -> None:
    state = State(1)
    state.q[:], state.dq[:], state.tau[:] = np.nan, np.inf, -np.inf
    write(tmp_path, [*inputs(describe(1)), Record(Kind.STATE, START, state.dump())])
    log = Log.open(tmp_path)
    export_csv(log, tmp_path / "a.csv")
    (row,) = read_csv(tmp_path / "a.csv")[1]
    assert (row["q.joint_0"], row["dq.joint_0"], row["tau.joint_0"]) == ("nan", "inf", "-inf")


def test_without_a_description_joints_have_numbers(tmp_path: Path) -> None:
    write(tmp_path, ticks(2, 5))
    export_csv(Log.open(tmp_path), tmp_path / "a.csv")
    assert "q.1" in read_csv(tmp_path / "a.csv")[1][0]
    export_npz(Log.open(tmp_path), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as found:
        assert found["joint_names"].size == 0


def test_the_ending_chooses_the_format_and_the_side_the_log(tmp_path: Path) -> None:
    for side, count in (("robot", 4), ("controller", 3)):
        write(tmp_path, inputs(describe(1)) + ticks(1, count), side=side)
    assert "4 rows" in str(export(tmp_path, tmp_path / "a.csv"))
    assert "3 rows" in str(export(tmp_path, tmp_path / "a.csv", "controller"))
    assert "3 rows" in str(export(tmp_path / "controller.mcap", tmp_path / "a.csv"))
    assert "arrays" in str(export(tmp_path, tmp_path / "a.npz"))
    with pytest.raises(UsageError, match=r"End the name in \.csv or \.npz"):
        export(tmp_path, tmp_path / "a.xls")
    with pytest.raises(LogError, match="No such file"):
        export(tmp_path / "no.mcap", tmp_path / "a.csv")


def test_an_export_of_a_cut_log_says_what_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path, inputs(describe(1)) + ticks(1, 1200)).paths[0]
    path.write_bytes(path.read_bytes()[:-200_0])
    written = export(tmp_path, tmp_path / "a.csv")
    assert not written.complete
    assert "and all that came after are lost" in written.missing


@pytest.mark.parametrize("name", ["no/a.csv", "no/a.npz"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, name: str) -> None:
    write(tmp_path, ticks(1, 5))
    with pytest.raises(UsageError, match="cannot be written"):
        export(tmp_path, tmp_path / name)


def test_extra_columns_have_the_names_that_the_controller_gives_them(tmp_path: Path) -> None:
    description = describe(1)
    session = {"side": "controller", "session_id": 1, "lockstep": True, "extra": ["gain_per_s"]}
    setpoint = Setpoint(1, 1)
    setpoint.extra[0] = 2.5
    state = State(1)
    log = Log.open(
        write(
            tmp_path / "controller.mcap",
            [
                Record(Kind.DESCRIPTION, 1, description.to_json()),
                Record(Kind.SESSION, 2, json.dumps(session).encode()),
                Record(Kind.STATE, 3, state.dump()),
                Record(Kind.SETPOINT, 4, setpoint.dump()),
            ],
        ).paths[0]
    )
    export_csv(log, tmp_path / "out.csv")
    _, (row,) = read_csv(tmp_path / "out.csv")
    assert row["setpoint.extra.gain_per_s"] == "2.5"
