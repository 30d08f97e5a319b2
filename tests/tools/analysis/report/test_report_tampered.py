"""Verdicts of a report follow from States and Setpoints, not from what a log concludes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.command_bench import inside

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter

Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that ends far from its target."""
    folder = tmp_path_factory.mktemp("run") / "run"
    words = ("run", "--lockstep", "--controller", "qp12", "--duration", "0.05")
    inside(*words, "--out", folder)
    return folder


def _reported(
    run: Path, out: Path, side: str, kind: Kind | None, change: Change | None, *given: str
) -> tuple[int, dict[str, Any], str]:
    """What `hoap3 report` makes of a log with one input changed, or removed, or without config."""
    log, kept = Log.open(run, side=side), []
    for record in log.records():
        if record.kind != kind:
            kept.append(record)
        elif change is not None:
            content = json.loads(record.payload)
            change(content)
            kept.append(record._replace(payload=json.dumps(content).encode()))
    shutil.copytree(run, out)
    path = out / f"{side}.mcap"
    path.unlink()
    enclosed = {**log.attachments, **({} if kind else {"config.yaml": "\n".join(given).encode()})}
    facts = {
        name: each for name, each in log.metadata.items() if name not in ("log", "clock", "end")
    }
    with LogWriter(
        path, robot=log.robot, side=side, attachments=enclosed, metadata=facts
    ) as writer:
        for record in kept:
            writer.add(record)
    done = inside("report", out, "--json")
    return done.code, json.loads(done.stdout), done.stderr


def _unjudged(summary: dict[str, Any]) -> None:
    summary["tasks"][0]["judged"] = False


def _wider(summary: dict[str, Any]) -> None:
    summary["tasks"][0] |= {"tolerance": 1.0, "within": True}


@pytest.mark.slow
@pytest.mark.parametrize("change", [None, _unjudged, _wider])
def test_the_task_is_judged_by_the_ticks(change: Change | None, run: Path, tmp_path: Path) -> None:
    before = json.loads(inside("report", run, "--json").stdout)

    code, figures, told = _reported(run, tmp_path / "o", "controller", Kind.SUMMARY, change)

    assert code == 1
    assert figures["verdicts"] == before["verdicts"]
    assert figures["task"] == before["task"]
    assert not before["task"]["errors"][0]["within"]
    verified = figures["verified"]
    if change is None:
        assert any(part.startswith("summary") for part in verified["unjudged"])
        assert "summary" in told
    else:
        assert verified["false_claims"] == ["summary: tasks"]


def _bad_name(description: dict[str, Any]) -> None:
    description["joints"][0]["name"] = "a/b"


@pytest.mark.slow
@pytest.mark.parametrize("side", ["robot", "controller"])
@pytest.mark.parametrize(
    ("kind", "change", "part"),
    [
        (Kind.DESCRIPTION, _bad_name, "description"),
        (Kind.DESCRIPTION, None, "description"),
        (Kind.SESSION, None, "session"),
        (Kind.SUMMARY, None, "summary"),
        (None, None, "config"),
    ],
)
def test_a_part_that_cannot_be_judged_is_named(
    side: str, kind: Kind | None, change: Change | None, part: str, run: Path, tmp_path: Path
) -> None:
    code, figures, told = _reported(run, tmp_path / "o", side, kind, change)

    assert code == 1
    assert any(each.startswith(part) for each in figures["verified"]["unjudged"])
    assert part in told


@pytest.mark.slow
def test_a_controller_of_ones_own_is_repeated_only_where_that_is_allowed(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller as Mine\n"
    (tmp_path / "my_law.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    config = Log.open(run, side="controller").config.replace(
        "controller: qp12", "controller: my_law:Mine"
    )
    code, figures, told = _reported(run, tmp_path / "o", "controller", None, None, config)

    assert code == 1  # not verified
    assert figures["task"]["errors"][0]["task"]  # as the controller stated it
    assert any("own summary" in gap for gap in figures["gaps"])
    assert "--allow-code" in told
    allowed = json.loads(inside("report", tmp_path / "o", "--json", "--allow-code").stdout)
    assert allowed["task"]["errors"][0]["task"]
