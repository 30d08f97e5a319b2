"""A ball and a wall that hierarchies keep: against quadprog, and in lockstep."""

from __future__ import annotations

from functools import cache

import pytest
from hierarchy_runs import PLACES
from obstacle_runs import RANKED, avoiding

from hoap3.tools.services.simulate import Simulation, simulate

RUNS = [(place, name) for place in PLACES for name in RANKED]


@cache
def run(place: str, name: str, seconds: float) -> Simulation:
    return simulate(PLACES[place], avoiding(place, name), seconds)


@pytest.mark.parametrize("seconds", [0.3, pytest.param(2.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("place", "name"), RUNS)
def test_ball_and_wall_are_kept_though_targets_lie_behind(place, name, seconds):
    done = run(place, name, seconds)
    margins = done.setpoints["margin"]
    assert margins.min() >= -done.controller.margin_tolerance == -1e-6
    assert set(done.setpoints["fallback"]) <= {0, 4}
    if seconds > 1.0:
        ball, _ = done.controller.stack.constraints
        assert ball.margin() < 1e-3  # the hand came to it
