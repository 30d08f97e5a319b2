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

from hoap3.tools.analysis.ticks import STAGES, TickTable

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
    guilty, slow = ticks.attributed_stages, slow_cycles(ticks, stage, busy_ms)
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
    begins, ends = np.array(link.windows).T
    sent = ticks.published[:, None]
    held = ((begins <= sent) & (sent <= ends - MS)).any(axis=1)
    guilty = ticks.attributed_stages
    return [guilty[tick] for tick in ticks.tick[held].tolist() if tick in guilty]


@pytest.mark.long
@pytest.mark.parametrize(("seconds", "least", "share"), [(1.5, 1, 0.5), (60.0, 200, 0.99)])
def test_a_link_that_delivers_late_answers_for_what_it_held(seconds, least, share, tmp_path):
    named = held_up(tmp_path / "log", seconds)
    assert len(named) > least
    assert named.count("network") >= share * len(named)
