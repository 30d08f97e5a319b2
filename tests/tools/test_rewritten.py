"""Replay, verify, report and timing of a run that another MCAP tool has written again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.command_bench import assert_ran, inside
from support.logs.rewritten_log import WAYS, rewritten

from hoap3.tools.analysis.replay import replay
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.bench.latency.latency import analyse_log
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

FAST = {"lz4", "shuffled"}
SIDES = ("robot", "controller")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "log"
    assert_ran(inside("run", "--lockstep", "--robot", "ur5", "--duration", "0.2", "--out", folder))
    return folder


def said(folder: Path) -> dict[str, Any]:
    """All that is said of a run, but where it lies."""
    found = {
        "replay": replay(folder, []).as_json(),
        "verify": verify(folder).as_json(),
        "report": read_content(folder).as_json(),
        "latency": analyse_log(folder),
    }
    for each in found.values():
        each.pop("log", None)
    return found


def without_counts(said: Any) -> Any:
    """The same without how much was checked: the order of records of one time may be lost."""
    if isinstance(said, dict):
        return {name: without_counts(each) for name, each in said.items() if name != "checked"}
    return said


@pytest.mark.parametrize(
    "way",
    [way if way in FAST else pytest.param(way, marks=pytest.mark.slow) for way in WAYS],
)
def test_a_rewritten_run_says_the_same(run: Path, tmp_path: Path, way: str) -> None:
    for side in SIDES:
        rewritten(tmp_path / f"{side}.mcap", run / f"{side}.mcap", **WAYS[way])
    expected, found = said(run), said(tmp_path)
    assert found["replay"]["identical"]
    assert found["verify"]["verdict"] == "true"
    if "order" in WAYS[way]:
        expected, found = without_counts(expected), without_counts(found)
    assert found == expected
