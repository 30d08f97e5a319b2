"""The shipped config `obstacle`, judged by Coal on the shapes as they are given."""

from __future__ import annotations

import pytest
from coal_shapes import Scene
from support.constraint_bench import hoap3

from hoap3.remote_controller.config import read_config
from hoap3.remote_controller.constraints.collision.distance import Distance
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.services.simulate import simulate

SECONDS, EVERY = 3.5, 50


@pytest.mark.slow
def test_on_the_way_round_the_ball_no_watched_pair_is_nearer_than_the_clearance():
    content = read_config("obstacle")[0]
    (given,) = (
        each["parameters"]
        for each in content["parameters"]["constraints"]
        if each["constraint"] == "distance"
    )
    run = simulate("hoap3", content, SECONDS)
    assert set(run.setpoints["solver_status"]) == {STATUS["certified"]}
    (watched,) = (each for each in run.controller.stack.constraints if isinstance(each, Distance))
    assert any(name.startswith("ball") for name in watched.margin_names)
    scene = Scene(hoap3(), given["obstacles"])
    nearest = 1.0
    for q in run.states["q"][::EVERY]:
        scene.at(q)
        for name in watched.margin_names:
            distance = scene.distance(*name.split(" to "))
            assert distance >= given["clearance_m"] - 1e-6, name
            if "ball" in name:
                nearest = min(nearest, distance)
    assert nearest == pytest.approx(given["clearance_m"], abs=5e-4)  # the ball is in the way
