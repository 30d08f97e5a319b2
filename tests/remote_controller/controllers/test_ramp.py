"""The share of Ψ at the begin, also where a State says nonsense of skipped periods."""

from __future__ import annotations

import pytest

from hoap3.protocol.messages import State
from hoap3.remote_controller.controllers.ramp import Ramp


def shares(ramp: Ramp, *given: tuple[int, int]) -> list[float]:
    """Of States with these ticks and counts of skipped ones."""
    state, found = State(1), []
    for state.tick, state.skipped in given:
        ramp.advance(state)
        found.append(ramp.share)
    return found


def test_it_grows_with_the_ticks_that_were_not_skipped():
    ramp = Ramp(0.004, 1e-3)
    told = shares(ramp, (10, 3), (11, 3), (15, 6), (16, 6), (17, 6))
    assert told == pytest.approx([0.25, 0.5, 0.75, 1.0, 1.0])


@pytest.mark.parametrize("ramp_s", [0.0, 1e-4, 0.004])
def test_no_count_of_skipped_ticks_ends_it_or_turns_it_round(ramp_s: float):
    """Anybody may feign a State."""
    told = shares(Ramp(ramp_s, 1e-3), (10, 0), (11, 2**64 - 1), (12, 100), (13, 0))
    assert all(0.0 < share <= 1.0 for share in told)
