"""A long log is verified, and reported, a part at a time: alike, and in little memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tampering import changed_field, ran, rewrite

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.report import motion
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.logs import disk_rows
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

RUNS = {
    "qp12": ("--robot", "hoap3", "--controller", "qp12"),
    "pinv": ("--robot", "hoap3", "--controller", "pinv"),
    "jerk": ("--robot", "ur5", "--controller", "qp12", "--set", "emulator.setpoint_jerk_max=100"),
}
SHORT_S, LONG_S = 2, 12


def slow(value: int) -> Any:
    """A case that seldom finds what the others do not."""
    return pytest.param(value, marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=RUNS)
def story(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("story") / "run", *RUNS[request.param], seconds=0.3)


def in_parts(path: Path, part: int, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What is found of a log so many cycles at a time; rounding is measured within a part."""
    monkeypatch.setattr(disk_rows, "PART", part)
    found = verify(path).as_json()
    for count in found["claims"].values():
        count.pop("largest")
    return found


@pytest.mark.parametrize("part", [*map(slow, (1, 7)), 100, slow(299)])
def test_parts_of_any_size_come_to_the_same(story, part, monkeypatch):
    whole = in_parts(story, 1_000_000, monkeypatch)

    assert whole["verdict"] == "true"
    assert in_parts(story, part, monkeypatch) == whole


@pytest.mark.parametrize("part", [*map(slow, (1, 7)), 100])
@pytest.mark.parametrize("place", [0, slow(1), slow(98), 99, 100, 101, slow(102), 298])
def test_what_is_false_is_found_beside_the_edge_of_a_part(
    story, part, place, tmp_path, monkeypatch
):
    moved = changed_field(Kind.STATE, place, "reference", lambda q: q + 1e-2, joint=1)
    path = rewrite(story, "robot", tmp_path / "o", moved)
    whole = in_parts(path, 1_000_000, monkeypatch)

    assert whole["false"] > 0
    assert in_parts(path, part, monkeypatch) == whole


def peak(what: Callable[[Path], object], path: Path) -> int:
    """Most bytes that are held meanwhile."""
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    what(path)
    return tracemalloc.get_traced_memory()[1] - before


def messages(path: Path) -> int:
    """Bytes of the States and Setpoints in both logs."""
    logs = [Log.open(path, side) for side in ("robot", "controller")]
    return sum(rows.nbytes for log in logs for rows in (log.states(), log.setpoints()))


@pytest.mark.parametrize("what", [verify, read_content])
def test_much_less_is_held_than_the_logs_have(what, tmp_path, monkeypatch):
    monkeypatch.setattr(disk_rows, "PART", 1000)
    monkeypatch.setattr(motion, "MOST_POINTS", 1000)
    paths = [
        ran(tmp_path / str(seconds), "--controller", "qp12", seconds=seconds)
        for seconds in (SHORT_S, LONG_S)
    ]
    what(paths[0])  # what is loaded once for all
    tracemalloc.start()
    try:
        short, long = (peak(what, path) for path in paths)
    finally:
        tracemalloc.stop()
    more = np.diff([messages(path) for path in paths])[0]
    assert long - short < more / 4
