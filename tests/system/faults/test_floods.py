"""A robot under attack from its network: nobody ends, memory is bounded, the controller is back."""

from __future__ import annotations

from dataclasses import asdict

import pytest
from flood_bench import measure
from floods import KINDS
from support.command_bench import spread

OFTEN = {"big:control/change": 20, "messages": 20}  # times; the others 3
SECONDS = 10.0
BACK_S = 10.0  # the promise
MOST_MB = 600  # of one process; 220 and 270 without an attack


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_outlasts_a_flood_and_follows_its_controller_again(kind):
    rounds = OFTEN.get(kind, 3)
    floods = measure(kind, rounds, SECONDS, lambda flood: print(asdict(flood)))
    largest = max(max(flood.robot_mb, flood.controller_mb) for flood in floods)
    back = sum(0.0 <= flood.back_s <= BACK_S for flood in floods)
    stops = [each for flood in floods for each in flood.stops_ms]
    print(f"{kind}: back within {BACK_S:g} s in {back} of {rounds} rounds")
    print(f"{kind}: back: {spread([flood.back_s for flood in floods], 's')}")
    print(f"{kind}: resident memory at most {largest} MB, {MOST_MB} MB are allowed")
    print(f"{kind}: stop while the flood runs: {spread(stops, 'ms')}")
    assert [flood.ended for flood in floods] == [[]] * rounds  # nobody crashed
    assert back == rounds
    assert 0 < largest <= MOST_MB
    assert all(flood.stops_ms and not flood.unanswered for flood in floods)
