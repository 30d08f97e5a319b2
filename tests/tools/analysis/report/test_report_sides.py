"""`hoap3 report` of the separate folders of two services, and without verification."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from support.log_samples import MS, START, describe, inputs, ticks, write
from typer.testing import CliRunner

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.cli.app import app
from hoap3.tools.logs.log import Log, open_sides

pytestmark = pytest.mark.slow


def figures(*arguments: Any) -> tuple[int, dict[str, Any]]:
    """Exit code and `--json` of a report."""
    result = CliRunner().invoke(app, ["report", *map(str, arguments), "--json"])
    return result.exit_code, json.loads(result.stdout)


@pytest.fixture
def sides(lockstep: Any, tmp_path: Path) -> list[Path]:
    """The folders of two services, each with its own log."""
    folders = []
    for side in ("robot", "controller"):
        folders.append(tmp_path / f"of_{side}")
        folders[-1].mkdir()
        shutil.copy(lockstep[0] / f"{side}.mcap", folders[-1])
    return folders


def test_two_folders_give_the_report_of_one(lockstep: Any, sides: list[Path], tmp_path: Path):
    whole = figures(lockstep[0], "--out", tmp_path / "one.html")
    apart = figures(*sides, "--out", tmp_path / "two.html")
    assert apart[1]["log"] == ", ".join(map(str, sides))
    for _, found in (whole, apart):
        del found["report"], found["log"]
    assert apart == whole


def test_without_verification_the_verdicts_are_the_same(lockstep: Any, tmp_path: Path):
    code, whole = figures(lockstep[0], "--out", tmp_path / "whole.html")
    quick_code, quick = figures(lockstep[0], "--no-verify", "--out", tmp_path / "quick.html")
    assert (quick_code, quick["verdicts"]) == (code, whole["verdicts"])
    assert quick["verified"]["verdict"] == "not verified"
    assert any("--no-verify" in gap for gap in quick["gaps"])


def test_logs_of_a_restarted_side_are_refused_with_the_reports_that_can_be_made(tmp_path: Path):
    for folder, side in (("one", "robot"), ("two", "controller"), ("three", "controller")):
        (tmp_path / folder).mkdir()
        records = [*inputs(describe(3)), *ticks(3, 2)]
        write(tmp_path / folder / f"{side}.mcap", records, side=side)
    folders = [tmp_path / folder for folder in ("two", "three", "one")]
    with pytest.raises(LogError) as refused:
        open_sides(*folders)
    commands = re.findall("`hoap3 report (.*?) --out", str(refused.value))
    pairs = [[Path(each) for each in command.split()] for command in commands]
    second, third, robot = (next(folder.iterdir()) for folder in folders)
    assert pairs == [[robot, second], [robot, third]]
    for pair in pairs:
        assert len(open_sides(*pair)[0]) == 2


def test_logs_of_two_sessions_are_refused(sides: list[Path], tmp_path: Path):
    other = tmp_path / "other"
    other.mkdir()
    write(other / "controller.mcap", [*inputs(describe(3)), *ticks(3, 2)], side="controller")
    with pytest.raises(LogError):
        open_sides(sides[0], other)


def test_a_loaded_log_gives_the_records_of_the_file(lockstep: Any):
    for side in ("robot", "controller"):
        streamed, loaded = (Log.open(lockstep[0], side) for _ in range(2))
        assert list(loaded.load().records()) == list(streamed.records())
        kinds = (Kind.SESSION, Kind.SETPOINT)
        some = list(loaded.records(*kinds))
        assert some == [each for each in streamed.records() if each.kind in kinds]
        assert loaded.count(Kind.SETPOINT) == sum(each.kind == Kind.SETPOINT for each in some)


def test_messages_of_another_layout_or_schema_keep_their_place(tmp_path: Path):
    begin = inputs(describe(3))
    records = [*begin, *ticks(3, 3), *ticks(5, 2, first=3), *ticks(3, 8, first=5, extra=4)]
    write(tmp_path / "robot.mcap", [*records, Record(Kind.STATE, START + 100 * MS, b"short")])
    streamed, loaded = (Log.open(tmp_path, "robot") for _ in range(2))
    assert list(loaded.load().records()) == list(streamed.records())
