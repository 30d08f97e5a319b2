"""What a State tells of the reference: its velocity, its acceleration, and which setpoint it is."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import Bench, active
from support.small_arm import arm

from hoap3.protocol.messages import State

TOLD = {"reference_rate": 3, "reference_acceleration": 3, "followed": 1}
T = 1e-3


def telling(**given: object) -> Bench:
    """An active robot that tells of its motion."""
    return active(description=arm().model_copy(update={"state_arrays": TOLD}), **given)


@pytest.mark.parametrize("policy", ["hold", "extrapolate"])
def test_rate_and_acceleration_are_the_differences_of_the_reference(policy):
    bench = telling(fate=lambda tick, answer: [(1000, answer)] if tick % 5 else [])
    random = np.random.default_rng(3)
    for _ in range(60):
        bench.speed[:] = random.uniform(-0.5, 0.5, 3)
        bench.run(1)
    states = bench.states()
    reference = np.array([state.reference for state in states])
    rate = np.diff(reference, axis=0) / T
    told = np.array([state.reference_rate for state in states])[1:]
    change = np.array([state.reference_acceleration for state in states])[2:]
    np.testing.assert_allclose(told, rate, rtol=0, atol=4 * np.spacing(4.0) / T)
    np.testing.assert_allclose(change, np.diff(told, axis=0) / T, rtol=1e-12, atol=1e-9)
    assert np.abs(told).max() > 0.1


def test_followed_is_the_newest_setpoint_that_was_taken():
    bench = telling(fate=lambda tick, answer: [] if tick in {20, 21} else [(1000, answer)])
    bench.run(30)
    found = {state.tick: state.followed[0] for state in bench.states()}
    first = min(state.tick for state in bench.states() if state.mode == State.ACTIVE)
    assert found[first] == -1.0
    assert [found[tick] for tick in range(19, 25)] == [18.0, 19.0, 19.0, 19.0, 22.0, 23.0]


def test_at_rest_nothing_is_followed_and_nothing_moves():
    bench = telling()
    bench.speed[:] = 0.3
    bench.run(20)
    bench.link.ask("stop")
    state = bench.run(300)
    assert state.mode == State.STOPPED
    assert state.followed[0] == -1.0
    assert not state.reference_rate.any()
    assert not state.reference_acceleration.any()


def test_a_robot_that_does_not_say_so_sends_none_of_it():
    bench = active()
    state = bench.run(5)
    assert len(state.reference_rate) == len(state.followed) == 0
