"""Exports hold the numbers of the log, to the bit."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.log_samples import MS, START, describe, fill, inputs, ticks, write

from hoap3.protocol.errors import LogError, NotInstalledError, UsageError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.export import export, export_csv, export_npz
from hoap3.tools.logs.log import Log

JOINTS = 3


def read_csv(path: Path) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """What the JSON file beside it says, and rows by column."""
    about = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    with path.open(encoding="utf-8", newline="") as stream:
        return about, list(csv.DictReader(stream))


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


@pytest.mark.slow
def test_csv_equals_the_arrays(tmp_path: Path) -> None:
    write(tmp_path, inputs(describe(JOINTS)) + ticks(JOINTS, 2500))  # more than two blocks
    log = Log.open(tmp_path)
    assert export_csv(log, tmp_path / "a.csv") == 2500
    about, rows = read_csv(tmp_path / "a.csv")
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
    columns = about["columns"]
    assert list(columns) == list(rows[0])
    assert columns[f"q.{names[0]}"]["meaning"]
    assert columns["setpoint.rho"]["meaning"]
    assert about["joint_names"] == list(names)
    assert (about["held"], about["left_out"]) == (
        {"states": 2500, "setpoints": 2500},
        {"events": 358, "inputs": 3},
    )


def message(kind: Kind, tick: int, session: int, stamp: int) -> Record:
    sample = State(1) if kind == Kind.STATE else Setpoint(1)
    rng = np.random.default_rng(stamp)
    return Record(kind, stamp, fill(sample, rng, tick=tick, session_id=session))


SENT = st.tuples(
    st.sampled_from([Kind.STATE, Kind.SETPOINT]), st.integers(0, 5), st.sampled_from([7, 1 << 62])
)


@pytest.mark.slow
@given(sent=st.lists(SENT, max_size=30))
def test_each_message_has_its_row(
    tmp_path_factory: pytest.TempPathFactory, sent: list[tuple[Kind, int, int]]
) -> None:
    """Whatever was lost, repeated, late, or of another session."""
    folder = tmp_path_factory.mktemp("log")
    records = [message(*what, START + place * MS) for place, what in enumerate(sent)]
    write(folder, records)
    answers: dict[tuple[int, int], list[str]] = {}
    for (kind, *key), record in zip(sent, records, strict=True):
        if kind == Kind.SETPOINT:
            answers.setdefault((key[0], key[1]), []).append(str(record.stamp))
    expected = []
    for (kind, *key), record in zip(sent, records, strict=True):
        if kind == Kind.STATE:
            left = answers.get((key[0], key[1]))
            expected.append((str(record.stamp), left.pop(0) if left else ""))
    expected += [("", stamp) for stamps in answers.values() for stamp in stamps]
    assert export_csv(Log.open(folder), folder / "a.csv") == len(expected)
    about, rows = read_csv(folder / "a.csv")
    found = [(row["log_time"], row["setpoint.log_time"]) for row in rows]
    assert sorted(found) == sorted(expected)
    logged = [state or setpoint for state, setpoint in found]
    assert logged == sorted(logged, key=int)
    assert about["rows_without_state"] == sum(not state for state, _ in expected)
    assert about["rows_without_setpoint"] == sum(not setpoint for _, setpoint in expected)
    for row in (row for row in rows if row["log_time"]):
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
    assert export(tmp_path, tmp_path / "a.csv").count == 4
    assert export(tmp_path, tmp_path / "a.csv", "controller").count == 3
    assert export(tmp_path / "controller.mcap", tmp_path / "a.csv").count == 3
    export(tmp_path, tmp_path / "a.npz")
    assert (tmp_path / "a.npz").exists()
    with pytest.raises(UsageError, match=r"\.csv, \.parquet or \.npz"):
        export(tmp_path, tmp_path / "a.xls")
    with pytest.raises(LogError, match=r"no\.mcap"):
        export(tmp_path / "no.mcap", tmp_path / "a.csv")


def test_an_export_of_a_cut_log_says_what_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path, inputs(describe(1)) + ticks(1, 1200)).paths[0]
    path.write_bytes(path.read_bytes()[:-200_0])
    written = export(tmp_path, tmp_path / "a.csv")
    assert not written.complete
    assert written.missing


@pytest.mark.parametrize("name", ["no/a.csv", "no/a.npz", "no/a.parquet"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, name: str) -> None:
    write(tmp_path, ticks(1, 5))
    with pytest.raises(UsageError, match=name):
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


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_pandas_reads_a_table_as_it_is(tmp_path: Path, ending: str) -> None:
    records = inputs(describe(JOINTS)) + ticks(JOINTS, 51)
    write(tmp_path, records[:-1])  # the last State has no answer
    log, path = Log.open(tmp_path), tmp_path / f"a.{ending}"
    export(tmp_path, path)
    read = pd.read_csv if ending == "csv" else pd.read_parquet
    rows, states, setpoints = read(path), log.states(), log.setpoints()
    assert len(rows) == len(states) == len(setpoints) + 1
    assert rows["tick"].dtype.kind in "iu"
    assert rows["tick"].tolist() == states["tick"].tolist()
    for place, name in enumerate(log.description.joint_names):
        assert rows[f"q.{name}"].dtype == np.float64
        assert rows[f"q.{name}"].tolist() == states["q"][:, place].tolist()
        found = rows[f"setpoint.values.{name}"]
        assert found.tolist()[:-1] == setpoints["values"][:, place].tolist()
    assert rows["setpoint.tick"].count() == len(setpoints)


def test_the_types_in_the_json_file_keep_every_bit(tmp_path: Path) -> None:
    session = (1 << 62) + 1  # no float64 holds it
    kinds = (Kind.STATE, Kind.SETPOINT, Kind.STATE)
    write(tmp_path, [message(k, n // 2, session, START + n) for n, k in enumerate(kinds)])
    export(tmp_path, tmp_path / "a.csv")
    about, _ = read_csv(tmp_path / "a.csv")
    types = {name: column["dtype"] for name, column in about["columns"].items()}
    rows = pd.read_csv(tmp_path / "a.csv", dtype=types)
    assert rows["setpoint.session_id"].tolist()[0] == session
    assert rows["setpoint.session_id"].isna().tolist() == [False, True]


def test_messages_of_several_layouts_are_all_exported(tmp_path: Path) -> None:
    """As where controllers took turns at one robot."""
    rng, records = np.random.default_rng(2), inputs(describe(2))
    for tick in range(90):
        arrays = ({"extra": 1}, {"gains": 2}, {"decision": 3, "extra": 4})[tick // 30]
        told = {"tick": tick, "session_id": 7}
        records.append(Record(Kind.STATE, START + 2 * tick, fill(State(2), rng, **told)))
        sent = fill(Setpoint(2, **arrays), rng, **told)
        records.append(Record(Kind.SETPOINT, START + 2 * tick + 1, sent))
    write(tmp_path, records)
    for ending in ("csv", "parquet", "npz"):
        written = export(tmp_path, tmp_path / f"a.{ending}")
        assert written.held["setpoints"] == 90
        assert written.complete
    rows = pd.read_csv(tmp_path / "a.csv")
    assert rows["setpoint.tick"].tolist() == list(range(90))
    assert rows["setpoint.extra.0"].count() == 60
    assert rows["setpoint.gains.1"].count() == 30
    with np.load(tmp_path / "a.npz") as arrays:
        assert len(arrays["setpoint.tick"]) == 90


def test_a_file_that_is_replaced_is_named(tmp_path: Path) -> None:
    write(tmp_path, ticks(1, 5))
    (tmp_path / "a.json").write_text("somebody's own")
    assert export(tmp_path, tmp_path / "a.csv").replaced == (str(tmp_path / "a.json"),)
    both = (str(tmp_path / "a.csv"), str(tmp_path / "a.json"))
    assert export(tmp_path, tmp_path / "a.csv").replaced == both


def test_without_pyarrow_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, ticks(1, 5))
    monkeypatch.setattr("hoap3.tools.machine.machine.find_spec", lambda _: None)
    with pytest.raises(NotInstalledError, match=r"hoap3\[parquet\]"):
        export(tmp_path, tmp_path / "a.parquet")
    assert not (tmp_path / "a.parquet").exists()
