"""Whose fault a miss was, over Zenoh: a controller that is slow now and then is found out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_bench import PATIENT, hoap3, on_path

from tools.ticks import SKIPPED, STAGES, TickTable

HERE = Path(__file__).parent


def run(folder, duration, every, busy_ms):
    """Ticks of a run, and those in which the controller was slow."""
    done = hoap3(
        "run", "--controller", "slow_controllers:Busy", "--duration", duration, "--out", folder,
        "--set", f"controller.parameters.every={every}",
        "--set", f"controller.parameters.busy_ms={busy_ms}",
        *(word.replace("misses", "emulator.misses") for word in PATIENT),
        environment=on_path(HERE),
    )  # fmt: skip
    assert done.process.returncode in {0, 1}, done.stderr
    ticks = TickTable.from_run(folder)
    slow = [
        tick
        for tick, outcome in zip(ticks.tick.tolist(), ticks.outcome.tolist(), strict=True)
        if tick % every == 0 and outcome != SKIPPED
    ]
    return ticks, slow


def test_a_busy_solve_answers_for_the_ticks_that_it_cost(tmp_path):
    ticks, slow = run(tmp_path / "log", 2, 250, 5.0)
    guilty = ticks.guilty()
    answered = ticks.tick[~np.isnan(ticks.stage("rtt"))]
    slow = [tick for tick in slow if tick in answered]  # and not itself overwritten by noise
    assert slow
    named = [guilty[tick] for tick in slow]
    assert named.count("solve") > len(named) / 2
    cost = [guilty.get(tick + 1) for tick in slow if tick + 1 in ticks.tick]
    assert cost.count("solve") > len(cost) / 2  # overwritten, or waited: not its own fault


@pytest.mark.long
def test_nearly_all_of_many_slow_ticks_are_the_solves(tmp_path):
    ticks, slow = run(tmp_path / "log", 60, 500, 2.0)
    guilty = ticks.guilty()
    others = np.stack([ticks.stage(name) for name in STAGES if name != "solve"])
    calm = (np.nan_to_num(others) < 1e6).all(axis=0) & ~np.isnan(ticks.stage("rtt"))
    undisturbed = set(ticks.tick[calm].tolist())  # by other load of more than a period
    named = [guilty.get(tick) for tick in slow if tick in undisturbed]
    assert len(named) > 60
    assert named.count("solve") >= 0.99 * len(named)
