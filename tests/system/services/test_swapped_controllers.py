"""A robot keeps running while controllers take turns: its log, export and report are whole."""

from __future__ import annotations

import signal
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from support.command_bench import (
    PATIENT,
    QUIET,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    inside,
    wait_for_mode,
    wait_for_ticks,
)

TICKS = 1500  # for which each controller commands, or a little more
SWAPPED = ("qp12", "pinv", "stable_qp")


def turn(name: str, at: str) -> None:
    """A controller commands the robot for a while, and gives it back."""
    with controller(name, *QUIET, at=at) as command:
        command.wait_for("following robot")
        wait_for_ticks(at, TICKS)
        assert command.end(signal.SIGTERM) == 0
        assert_no_traceback(command)
    wait_for_mode("idle", at)


@pytest.mark.slow
def test_each_setpoint_of_every_controller_is_exported_and_reported(tmp_path: Path) -> None:
    at, out = endpoint(), tmp_path / "log"
    with emulator("hoap3", *PATIENT, "--out", out, at=at) as robot:
        for name in SWAPPED:
            turn(name, at)
        robot.end(signal.SIGTERM)
        assert_no_traceback(robot)
    counts, sizes = Counter[str](), set[int]()
    with (out / "robot.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            counts[channel.topic.rpartition("/")[2]] += 1
            if channel.topic.endswith("/setpoint"):
                sizes.add(len(message.data))
    assert len(sizes) > 1  # several layouts
    for ending in ("csv", "parquet"):
        to = tmp_path / f"run.{ending}"
        done = inside("export", out, "--to", to, "--json")
        assert done.code == 0
        held = {"states": counts["state"], "setpoints": counts["setpoint"]}
        assert done.json()["held"] == held
        rows = pd.read_csv(to) if ending == "csv" else pd.read_parquet(to)
        assert rows["log_time"].count() == counts["state"]
        assert rows["setpoint.log_time"].count() == counts["setpoint"]
    assert inside("export", out, "--to", tmp_path / "run.npz").code == 0
    with np.load(tmp_path / "run.npz") as arrays:
        assert len(arrays["setpoint.tick"]) == counts["setpoint"]
        assert len(arrays["event.kind"]) == counts["events"]
    report = inside("report", out, "--out", tmp_path / "report.html", "--json").json()
    assert report["answers"]["setpoints"] == counts["setpoint"]
    known = report["answers"]
    assert known["shown"] + known["left_out"] == counts["setpoint"]
    assert known["with_status"] + known["without_status"] == known["shown"]
    assert known["shown"] > len(SWAPPED) * TICKS // 2
