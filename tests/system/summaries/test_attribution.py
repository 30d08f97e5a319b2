"""Whose fault a miss was, over Zenoh: what is slow now and then is found out."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from holding_link import HoldingLink
from support.command_bench import (
    PATIENT,
    controller,
    emulator,
    endpoint,
    hoap3,
    on_path,
    wait_for_mode,
)

from hoap3.tools.timing.ticks import STAGES, TickTable

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
MS = 1_000_000


def run(folder: Path, duration: int, every: int, busy_ms: float, stage: str) -> TickTable:
    """Ticks of a run whose controller is slow in every so many of them."""
    done = hoap3(
        "run", "--controller", "slow_controllers:Busy", "--duration", duration, "--out", folder,
        "--set", f"controller.parameters.every={every}",
        "--set", f"controller.parameters.busy_ms={busy_ms}",
        "--set", f"controller.parameters.stage={stage}",
        *(word.replace("misses", "emulator.misses") for word in PATIENT),
        environment=on_path(HERE),
    )  # fmt: skip
    assert done.process.returncode in {0, 1}, done.stderr
    return TickTable.from_run(folder)


def slow_cycles(ticks: TickTable, stage: str, busy_ms: float) -> list[int]:
    """Ticks that asked, were seen by the controller, and met its delay."""
    met = ticks.asked & (ticks.stage(stage) >= busy_ms * MS)
    return [int(tick) for tick in ticks.tick[met & ticks.missed]]


def named_and_met(ticks: TickTable, stage: str, busy_ms: float) -> tuple[list[str], int]:
    """Who is guilty of each miss that met the delay, but for those that met a longer one elsewhere.

    And how many there are with those.
    """
    guilty, slow = ticks.guilty(), slow_cycles(ticks, stage, busy_ms)
    others = np.stack([ticks.stage(name) for name in STAGES if name != stage])
    longer = set(ticks.tick[(np.nan_to_num(others) >= busy_ms * MS).any(axis=0)].tolist())
    return [guilty[tick] for tick in slow if tick not in longer], len(slow)


def test_a_busy_stage_answers_for_the_ticks_that_it_cost(tmp_path):
    named, met = named_and_met(run(tmp_path / "log", 2, 250, 5.0, "solve"), "solve", 5.0)
    assert met > 0
    assert named.count("solve") >= 0.7 * len(named)


@pytest.mark.long
@pytest.mark.parametrize("stage", ["solve", "encode"])
def test_nearly_all_of_many_slow_ticks_are_that_stages(tmp_path, stage):
    named, met = named_and_met(run(tmp_path / "log", 60, 500, 2.0, stage), stage, 2.0)
    assert met > 100
    assert len(named) > 0.9 * met
    assert named.count(stage) >= 0.99 * len(named)


def held_up(folder: Path, seconds: float) -> list[str]:
    """Who is guilty of each miss whose State or answer was held up by a link."""
    at = endpoint()
    with emulator("hoap3", *PATIENT, "--out", folder, at=at) as robot:
        link = HoldingLink(int(at.rpartition(":")[2]), every=500 * MS, hold=4 * MS)
        never = ("--set", "parameters.every=1000000000")
        busy = ("slow_controllers:Busy", *never, "--out", folder)
        with controller(*busy, at=link.endpoint, environment=on_path(HERE)) as law:
            wait_for_mode("active", at)
            assert not law.ended_within(seconds)
            assert law.end(signal.SIGTERM) == 0
        assert robot.end(signal.SIGTERM) in {0, 1}
        link.close()
    ticks = TickTable.from_run(folder)
    guilty, names = ticks.guilty(), []
    for place in range(len(ticks)):
        published = int(ticks.published[place])
        if int(ticks.tick[place]) in guilty and any(
            begin <= published <= end - MS for begin, end in link.windows
        ):
            names.append(guilty[int(ticks.tick[place])])
    return names


@pytest.mark.long
def test_a_link_that_delivers_late_answers_for_what_it_held(tmp_path):
    named = held_up(tmp_path / "log", 1.5)
    assert len(named) > 1
    assert named.count("network") > len(named) / 2


@pytest.mark.long
def test_nearly_all_that_a_link_held_is_the_links(tmp_path):
    named = held_up(tmp_path / "log", 60.0)
    assert len(named) > 200
    assert named.count("network") >= 0.99 * len(named)
