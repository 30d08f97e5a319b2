"""The comparison finds what differs, and nothing else."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import CRCValidationError
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record

from .__main__ import compare_case, show, summarise
from .cases import Case, all_cases, lockstep
from .damage import flip, flip_in_chunks, rewrite, truncate
from .difference import Difference
from .json_tree import compare_json
from .ledger import LEDGER, read_ledger
from .messages import compare_logs, read_topics
from .outputs import compare_folders, write_output
from .revision import HERE, Revision, dependencies_of, runtime_directory
from .tables import compare_arrays, compare_csv

OLD = {
    "verdict": "good",
    "task": {"errors": [{"error": 0.5, "note": ""}, {"error": 1.0, "note": "x"}]},
    "ticks": 3000,
}


def changed_copy(**changes: object) -> dict[str, object]:
    return {**json.loads(json.dumps(OLD)), **changes}


@pytest.mark.parametrize(
    ("new", "field", "kind", "size"),
    [
        (changed_copy(ticks=2999), "run.json:ticks", "changed", 1.0),
        (changed_copy(ticks=3000.0), "run.json:ticks", "changed", 0.0),
        (changed_copy(ticks=True), "run.json:ticks", "changed", None),
        (changed_copy(verdict="pass"), "run.json:verdict", "changed", None),
        (changed_copy(reason=None), "run.json:reason", "added", None),
        ({k: v for k, v in OLD.items() if k != "task"}, "run.json:task", "removed", None),
        (changed_copy(task={"errors": [OLD["task"]["errors"][1]]}), "run.json:task.errors.0",
         "removed", None),
        (changed_copy(task=None), "run.json:task", "changed", None),
    ],
)  # fmt: skip
def test_one_changed_value_of_json_is_one_difference(new, field, kind, size):
    (found,) = compare_json(OLD, new, "run.json:")
    assert (found.field, found.kind, found.size) == (field, kind, size)


def test_equal_json_has_no_difference_also_where_it_holds_nan():
    text = '{"a": NaN, "b": [1, 2.5, null, "x"], "c": {}}'
    assert list(compare_json(json.loads(text), json.loads(text), "x:")) == []


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return inputs(describe(2)) + ticks(2, 50)


@pytest.fixture(scope="module")
def log(records: list[Record], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("log"), records).paths[0]


def differences(log: Path, records: list[Record], folder: Path) -> list[Difference]:
    return list(compare_logs(log, write(folder, records).paths[0], "log:"))


def test_the_same_records_are_equal_also_when_another_writer_has_written_them(
    log, records, tmp_path
):
    assert differences(log, records, tmp_path) == []
    copy = Path(shutil.copy(log, tmp_path / "copy.mcap"))
    rewrite(copy)
    assert copy.read_bytes() != log.read_bytes()
    assert list(compare_logs(log, copy, "log:")) == []


def test_the_least_bit_of_a_setpoint_is_found_with_its_tick(log, records, tmp_path):
    place = [i for i, record in enumerate(records) if record.kind == Kind.SETPOINT][17]
    schema = Setpoint.schema
    payload = bytearray(records[place].payload)
    message = np.frombuffer(payload, schema.dtype(schema.lengths_in(bytes(payload))))
    before = float(message["values"][0, 1])
    message["values"][0, 1] = np.nextafter(before, np.inf)
    altered = [*records]
    altered[place] = Record(Kind.SETPOINT, records[place].stamp, bytes(payload))
    (found,) = differences(log, altered, tmp_path)
    assert (found.field, found.where, found.count) == ("log:setpoint.values", "tick 17 [1]", 1)
    assert found.old == before
    assert found.size == np.nextafter(before, np.inf) - before


def test_a_missing_record_is_one_difference(log, records, tmp_path):
    place = [i for i, record in enumerate(records) if record.kind == Kind.STATE][30]
    (found,) = differences(log, records[:place] + records[place + 1 :], tmp_path)
    assert (found.field, found.kind, found.where) == ("log:state.rows", "removed", "tick 30")


def test_another_order_of_messages_is_a_difference(log, records, tmp_path):
    first, second = [i for i, record in enumerate(records) if record.kind == Kind.EVENT][:2]
    swapped = [*records]
    swapped[first], swapped[second] = records[second], records[first]
    assert [found.field for found in differences(log, swapped, tmp_path)] == ["log:events"]


def test_a_json_record_is_compared_by_its_keys(log, records, tmp_path):
    altered = [
        Record(r.kind, r.stamp, b'{"epoch": 4}') if r.kind == Kind.AUTHORITY else r for r in records
    ]
    (found,) = differences(log, altered, tmp_path)
    assert (found.field, found.size) == ("log:inputs.authority.0.body.epoch", 1.0)


def test_arrays_and_csv_are_compared_column_by_column(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    np.savez(one, t=[1, 2], q=[[1.0, 2.0], [3.0, np.nan]], gone=[1])
    np.savez(other, t=[1, 2], q=[[1.0, 2.0], [3.5, np.nan]], more=[1])
    found = {
        d.field: d for d in compare_arrays(one.with_suffix(".npz"), other.with_suffix(".npz"), "")
    }
    assert found.keys() == {"q", "gone", "more"}
    assert (found["q"].size, found["q"].where) == (0.5, "arrays [1, 0]")
    one.write_text("# a\nt,q\n1,2.5\n2,x\n")
    other.write_text("# b\nt,q\n1,2.25\n2,x\n")
    found = {d.field: d for d in compare_csv(one, other, "")}
    assert found.keys() == {"comments.0", "q"}
    assert (found["q"].size, found["q"].where, found["q"].count) == (0.25, "row 0", 1)


def ledger(*lines: str) -> list:
    return read_ledger(
        "\n".join(["| case | field | change | reason |", "|---|---|---|---|", *lines])
    )


RENAMED = "| `*` | `*.json:*verdict*` | `good -> pass` | verdicts have new values |"


@pytest.mark.parametrize(
    ("line", "difference", "covered"),
    [
        (RENAMED, Difference("run.json:verdicts.task", "changed", "good", "pass"), True),
        (RENAMED, Difference("run.json:verdicts.task", "changed", "good", "fail"), False),
        (RENAMED, Difference("run.json:verdicts.task", "changed", "bad", "pass"), False),
        (RENAMED, Difference("run.json:verdicts.task", "added", None, "pass"), False),
        (RENAMED, Difference("run.json:task.state", "changed", "good", "pass"), False),
        ("| a/* | x | <= 1e-9 | r |", Difference("x", "changed", 1.0, 1.0, 1e-10), True),
        ("| a/* | x | <= 1e-9 | r |", Difference("x", "changed", 1.0, 1.1, 0.1), False),
        ("| a/* | x | <= 1e-9 | r |", Difference("x", "changed", "y", "z"), False),
        ("| a/* | x.* | added | r |", Difference("x.y", "added"), True),
        ("| a/* | x.* | added | r |", Difference("x.y", "removed"), False),
        ("| b/* | x.* | any | r |", Difference("x.y", "changed"), False),
        ("| a/* | x | true -> * | r |", Difference("x", "changed", True, "all"), True),
    ],
)
def test_a_line_of_the_ledger_covers_what_it_names_and_no_more(line, difference, covered):
    (entry,) = ledger(line)
    assert entry.covers("a/b", difference) is covered


@pytest.mark.parametrize(
    "line", ["| a | b | any |", "| a | b | sometimes | r |", "| a | b | any | |"]
)
def test_a_line_of_the_ledger_that_says_nothing_is_refused(line):
    with pytest.raises(ValueError, match="ledger line 3"):
        ledger(line)


def test_the_ledger_of_the_repository_can_be_read():
    read_ledger(LEDGER.read_text(encoding="utf-8"))


def test_unexpected_differences_and_unused_lines_are_reported(capsys):
    lines = ledger(RENAMED, "| x | y | any | an old reason |")
    found = [
        Difference("run.json:verdict", "changed", "good", "pass"),
        Difference("run.json:ticks", "changed", 3000, 2999, 1.0),
    ]
    found += [Difference(f"run.json:ticks{i}", "changed", 3000, 2999, 1.0) for i in range(40)]
    case = Case("a/b", ())
    assert summarise([show(case, found[:1], lines)], lines, 1, 0.0) == 0
    assert summarise([show(case, found, lines)], lines, 1, 0.0) == 1
    printed = capsys.readouterr().out
    assert "intended: verdicts have new values" in printed
    assert "largest difference 1 (3000 -> 2999)" in printed
    assert printed.count("UNEXPECTED") == 41  # none is left out
    assert "unused ledger line 4: x | y" in printed


def test_elapsed_time_and_paths_are_ignored_but_not_that_a_key_is_gone(tmp_path):
    case, sides = Case("a/b", (lockstep("qp12", "hoap3"),)), []
    for name, seconds in (("old", 1.0), ("new", 2.0)):
        folder = tmp_path / name
        folder.mkdir()
        content = {"wall_s": seconds, "log": str(folder / "log")}
        write_output(case.steps[0], 0, json.dumps({"lockstep": content}), folder)
        sides.append((folder, tmp_path / "tree" / name))
    assert compare_folders(case, *sides) == []
    write_output(case.steps[0], 1, '{"lockstep": {"log": "x"}}', tmp_path / "new")
    fields = {each.field: each.kind for each in compare_folders(case, *sides)}
    assert fields == {
        "run.json:exit": "changed",
        "run.json:json.lockstep.log": "changed",
        "run.json:json.lockstep.wall_s": "removed",
    }


def test_a_log_that_cannot_be_read_is_a_difference(log, tmp_path):
    sides = [(tmp_path / name, tmp_path) for name in ("old", "new")]
    for folder, _ in sides:
        folder.mkdir()
        shutil.copy(log, folder / "robot.mcap")
    (tmp_path / "new" / "robot.mcap").write_bytes(b"")
    (found,) = compare_folders(Case("a/b", ()), *sides)
    assert found.field == "robot.mcap:file"


def test_damage_is_the_same_each_time(log, tmp_path):
    copies = [Path(shutil.copy(log, tmp_path / f"{i}.mcap")) for i in range(2)]
    for copy in copies:
        flip(copy, 5, count=3)
        truncate(copy, 0.9)
    assert copies[0].read_bytes() == copies[1].read_bytes()
    assert copies[0].read_bytes() != log.read_bytes()[: copies[0].stat().st_size]
    assert len(read_topics(log)["state"].data) == 50


def test_damage_in_chunks_leaves_the_others(log, tmp_path):
    copy = Path(shutil.copy(log, tmp_path / "copy.mcap"))
    flip_in_chunks(copy, 0.5)
    before, after = log.read_bytes(), copy.read_bytes()
    assert len(before) == len(after)
    assert sum(a != b for a, b in zip(before, after, strict=True)) == 1
    with copy.open("rb") as stream, pytest.raises(CRCValidationError):
        list(make_reader(stream, validate_crcs=True).iter_messages())


def test_names_of_cases_are_unique_and_every_pair_is_one():
    names = [case.name for case in all_cases()]
    assert len(names) == len(set(names))
    assert sum(name.startswith("pairs/") for name in names) >= 67
    assert sum(case.quick for case in all_cases() if case.name.startswith("pairs/")) == 10


def test_dependencies_decide_whether_an_environment_is_shared(tmp_path):
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(HERE / name, tmp_path / name)
    assert dependencies_of(tmp_path) == dependencies_of(HERE)
    (tmp_path / "constraints.txt").write_text("numpy==1.0\n")
    assert dependencies_of(tmp_path) != dependencies_of(HERE)


@pytest.mark.long
def test_the_current_tree_behaves_as_its_last_commit():
    words = "--against", "HEAD", "--cases", "pairs/qp12-ur5"
    done = subprocess.run(
        [sys.executable, "-m", "tests.frozen", *words],
        cwd=HERE, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "equal      pairs/qp12-ur5" in done.stdout, done.stdout + done.stderr


@pytest.mark.slow
def test_another_default_of_a_config_is_found_in_bytes_and_json(tmp_path):
    tree = tmp_path / "tree"
    shutil.copytree(
        HERE, tree, symlinks=True, ignore=shutil.ignore_patterns(".git", "tests", "docs")
    )
    config = tree / "remote_controller" / "configs" / "qp12.yaml"
    text = config.read_text(encoding="utf-8")
    config.write_text(text.replace("u_max_rad_s: 0.6", "u_max_rad_s: 0.5"), encoding="utf-8")
    old, new = (Revision(t.name, t, sys.executable) for t in (HERE, tree))
    case = Case("pairs/short", (lockstep("qp12", "ur5", seconds="0.5"),))
    found = {each.field for each in compare_case(case, old, new, tmp_path / "work")}
    assert {"log/robot.mcap:setpoint.values", "run.json:json.final_error"} <= found


def test_robots_of_one_case_are_not_found_by_another(tmp_path):
    one, other = Revision("x", HERE, sys.executable), tmp_path / "other"
    found = []
    for folder in (tmp_path / "one", tmp_path / "one", other):
        folder.mkdir(exist_ok=True)
        script = folder / "script.py"
        script.write_text("import os; print(os.environ['HOAP3_RUNTIME_DIR'])")
        found.append(one.start((str(script),), folder, stdout=subprocess.PIPE).communicate()[0])
    assert found[0] == found[1] != found[2]
    shutil.rmtree(runtime_directory())


@pytest.mark.parametrize("message", [State, Setpoint])
def test_only_lines_without_wildcards_cover_states_and_setpoints(message):
    name = message.__name__.lower()
    fields = [*message.schema.scalars, *message.schema.arrays, "log_time", "rows"]
    logs = [f"log/{side}.mcap:" for side in ("robot", "controller")]
    places = [f"{log}{name}.{field}" for log in logs for field in fields]
    places += [f"{log}{whole}" for log in logs for whole in (name, "file")]
    places += [f"{name}s.npy:{field}" for field in (*fields, "file")]
    wide = [e for e in read_ledger(LEDGER.read_text(encoding="utf-8")) if set(e.field) & set("*?[")]
    assert wide
    differences = [
        Difference(place, kind, 0.0, 1e-12, 1e-12)
        for place in places
        for kind in ("changed", "added", "removed")
    ]
    assert not [
        (case.name, entry.line, each.field)
        for case in all_cases()
        for entry in wide
        for each in differences
        if entry.covers(case.name, each)
    ]


def test_a_command_that_crashes_is_no_result(tmp_path):
    step = lockstep("qp12", "hoap3")
    with pytest.raises(RuntimeError, match="exit 1"):
        write_output(step, 1, "Traceback", tmp_path)
