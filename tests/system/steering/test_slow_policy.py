"""The slow policy of the examples steers a robot over the network for a minute."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import PATIENT, controller, emulator, endpoint, inside, wait_for_mode
from support.robots.steered_hand import MOVING, hands, lag_and_error, peak_jerk

import hoap3
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log, Rows
from hoap3.tools.replay import replay

pytestmark = pytest.mark.long

EXAMPLE = Path(__file__).parents[3] / "examples" / "slow_policy.py"
CENTRE = np.array([-0.55, -0.11, 0.3])
SECONDS = 60


def test_a_minute_of_chunks_over_the_network(tmp_path: Path) -> None:
    """Limits at every tick, no stop, no lag, little jerk; `verify` and `replay` agree."""
    at, folder = endpoint(), tmp_path / "run"
    with (
        emulator("ur5", "--out", folder, *PATIENT, at=at) as robot,
        controller("steered_ur5", "--out", folder, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, "ur5")
        words = [sys.executable, str(EXAMPLE), "--connect", at, "--seconds", str(SECONDS)]
        policy = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
        assert policy.returncode == 0, policy.stderr
        assert law.end(2) == 0
        robot.end(2)
    print(policy.stdout)
    assert "'refused': {}" in policy.stdout
    assert_followed(Log.open(folder, "robot").states(), chunks(folder))
    assert replay(folder, []).identical
    told = inside("verify", folder)
    print(told.stdout)
    assert told.code == 0


def chunks(folder: Path) -> list[tuple[int, np.ndarray]]:
    """When each chunk was taken, and the point that it then has for the next period."""
    found, tick = [], 0
    for record in Log.open(folder, "controller").records():
        if record.kind == Kind.STATE:
            (tick,) = State.scalars(record.payload, "tick")
        elif record.kind == Kind.TARGET:
            made = Target.like(record.payload)
            made.load(record.payload)
            points = made.values.reshape(made.points, made.dimension).copy()
            found.append((tick, points[-(-(tick - made.first_tick) // made.tick_step)]))
    return found


def assert_followed(states: Rows, taken: list[tuple[int, np.ndarray]]) -> None:
    """What the robot did while it was steered; `taken` says what holding would have done."""
    robot = hoap3.load_robot("ur5")
    first, last = taken[0][0], taken[-1][0]
    states = states[(states["tick"] >= first) & (states["tick"] <= last)]
    assert (states["mode"] == State.ACTIVE).all()
    assert (np.abs(states["reference_rate"]) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max
    assert (np.abs(states["reference_acceleration"]) <= most * (1 + 1e-9) + 1e-7).all()
    ticks, path = states["tick"].astype(int), hands(states["q"])
    policy = runpy.run_path(str(EXAMPLE))["Policy"](CENTRE)
    lag, error = lag_and_error(path, ticks, policy.place)
    naive = np.zeros_like(path)
    for tick, place in taken:
        naive[ticks >= tick] = place
    jerk, naive_jerk = (peak_jerk(each[MOVING], ticks[MOVING]) for each in (path, naive))
    print(
        f"{len(states)} States of {last - first + 1}, {len(taken)} chunks: lag {lag} ms, "
        f"RMS {1e3 * error:.4f} mm, jerk {jerk:.3g} against {naive_jerk:.3g} m/s^3"
    )
    assert lag <= 20
    assert error <= 2e-3
    assert jerk <= 0.1 * naive_jerk
