"""The picture and the tables of a soak, also of one that ended before anything was seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoap3.tools.bench.soak.judge import judge
from hoap3.tools.bench.soak.soak import draw, show_soak
from hoap3.tools.bench.soak.watch import HELD, Plan, Rounds, Watch
from hoap3.tools.machine.machine import machine_block


def result(watch: Watch) -> dict[str, Any]:
    """What a soak that failed at some time came to."""
    return {
        **judge(watch, 60.0, None, 64_000_000),
        "plan": {"duration_s": 600.0, "warm_up_s": 60.0},
        "interrupted": False,
        "failure": "the controller ended before the robot did",
        "machine": machine_block(),
        "transport": "zenoh tcp, same host",
        "files": ["soak.json"],
    }


@pytest.mark.parametrize("rounds", [0, 1, 2, 20])
def test_however_little_was_seen_it_is_shown(rounds, tmp_path: Path, capsys):
    doors = {"robot": ("127.0.0.1", 1), "controller": ("127.0.0.1", 1)}
    watch = Watch(Plan(600.0, 60.0), doors, 1_000_000, lambda _: None)
    for number in range(rounds):
        process = watch.processes.setdefault(7, Rounds(HELD, "robot"))
        process.add(58.0 + 5.0 * number, dict.fromkeys(HELD, 20))
        for side in watch.sides.values():
            side.add(58.0 + 5.0 * number, {})
    found = result(watch)
    draw(watch, found, tmp_path / "soak.png")
    assert (tmp_path / "soak.png").read_bytes().startswith(b"\x89PNG")
    show_soak(found)
    shown = capsys.readouterr().out
    assert found["failure"] in shown
    assert found["verdict"] == "fail"
    assert ("robot " in shown.split("memory")[0]) == (rounds > 1)
