"""A robot under attack from its network: nobody ends, memory is bounded, the controller is back."""

from __future__ import annotations

import pytest
from flood_bench import measure
from floods import KINDS

OFTEN = {"big:control/change": 20, "messages": 20}  # times; the others 3
SECONDS = 10.0
BACK_S = 10.0
MOST_MB = 600  # of one process; 220 and 270 without an attack


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_outlasts_a_flood_and_follows_its_controller_again(kind):
    floods = measure(kind, OFTEN.get(kind, 3), SECONDS, print)
    assert [flood.ended for flood in floods] == [[]] * len(floods)
    assert all(flood.stops_ms for flood in floods)
    assert all(0 <= flood.back_s <= BACK_S for flood in floods), floods
    assert max(max(flood.robot_mb, flood.controller_mb) for flood in floods) <= MOST_MB
