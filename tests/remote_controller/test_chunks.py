"""A policy that thinks for 300 ms steers a hand: no lag, little jerk, and to the bit again."""

from __future__ import annotations

import heapq
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.checked_answers import check_answers
from support.robots.steered_hand import MOVING, T, hands, lag_and_error, peak_jerk

import hoap3
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.configs import load_controller_config
from hoap3.tools.services.simulate import Simulation

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "slow_policy.py"))
STEP: int = EXAMPLE["STEP_TICKS"]
CENTRE = np.array([-0.55, -0.11, 0.3])


class Sender:
    """The example's policy in virtual time."""

    def __init__(self, seed: int) -> None:
        self.policy = EXAMPLE["Policy"](CENTRE, seed)
        self.grant: dict[str, Any] = {}
        self.held: list[tuple[int, np.ndarray]] = []  # naive: the point for now, held
        self._thinking: list[tuple[int, int]] = []
        self._number = 0

    def __call__(self, loop: ControllerLoop) -> None:
        tick = loop.last_tick
        if not loop.epoch:
            return
        if tick % 500 == 0 or not self.grant:
            self.grant = loop.operate("acquire", "policy")
        if tick % STEP == 0 and (arrival := self.policy.arrival(tick)) is not None:
            heapq.heappush(self._thinking, (arrival, tick))
        while self._thinking and self._thinking[0][0] <= tick:
            seen = heapq.heappop(self._thinking)[1]
            points = self.policy.chunk(seen)
            made = Target(len(points), 3)
            self._number += 1
            made.number, made.tick_step, made.first_tick = self._number, STEP, seen
            made.session_id, made.epoch = self.grant["session_id"], self.grant["epoch"]
            made.values[:] = points.ravel()
            loop.steer("policy", made.dump())
            self.held.append((tick, points[-(-(tick - seen) // STEP)]))


def steered(seconds: float, seed: int = 0) -> tuple[Simulation, Sender]:
    """A run in lockstep."""
    sender = Sender(seed)
    return hoap3.simulate("ur5", "steered_ur5", seconds, steer=sender), sender


def assert_follows(seconds: float) -> None:
    """What a policy may rely on."""
    run, sender = steered(seconds)
    robot, states = hoap3.load_robot("ur5"), run.states
    active = states[states["mode"] == State.ACTIVE]
    assert (states["mode"][: round(seconds / T)] != State.STOPPED).all()
    assert (np.abs(active["reference_rate"]) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max
    assert (np.abs(active["reference_acceleration"]) <= most * (1 + 1e-9) + 1e-7).all()
    path = hands(states["q"])
    ticks = states["tick"].astype(int)
    lag, error = lag_and_error(path, ticks, sender.policy.place)
    naive = np.zeros_like(path)
    for tick, place in sender.held:
        naive[tick:] = place
    jerk, naive_jerk = (peak_jerk(each[MOVING], ticks[MOVING]) for each in (path, naive))
    print(f"lag {lag} ms, RMS {1e3 * error:.4f} mm, jerk {jerk:.3g} against {naive_jerk:.3g} m/s^3")
    assert lag <= 20
    assert error <= 2e-3
    assert jerk <= 0.1 * naive_jerk
    again, _ = steered(seconds)
    assert all(one == other for one, other in zip(again.records, run.records, strict=True))
    assert replay_records(run.records, load_controller_config("steered_ur5")[0]).identical
    found = verified(run.records)
    assert (found["false"], found["unverified"]) == (0, 0)


def verified(records: list[Record]) -> dict[str, Any]:
    """What is recomputed of the answers without the code that made them."""
    parameters = load_controller_config("steered_ur5")[0].parameters
    return check_answers(records, "ghc_velocity", parameters).as_json()


@pytest.mark.slow
def test_chunks_that_come_late_are_followed_without_lag_and_repeated_to_the_bit():
    assert_follows(4.5)


@pytest.mark.long
def test_for_a_minute_too():
    assert_follows(60.0)


def test_without_the_targets_of_its_log_a_replay_differs():
    run, _ = steered(1.0)
    config = load_controller_config("steered_ur5")[0]
    fewer = [record for record in run.records if record.kind != Kind.TARGET]
    assert not replay_records(fewer, config).identical


@pytest.mark.slow
def test_verify_tells_a_target_that_was_changed_in_the_log():
    run, _ = steered(1.5)
    records = list(run.records)
    at = next(i for i, record in enumerate(records) if record.kind == Kind.TARGET)
    target = Target.like(records[at].payload)
    target.load(records[at].payload)
    target.values[0::3] += 1e-6
    records[at] = records[at]._replace(payload=target.dump())
    assert verified(run.records)["false"] == 0
    assert verified(records)["false"] > 0
