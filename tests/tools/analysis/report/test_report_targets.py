"""Targets that are sent during a run are drawn where they were at each tick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.html_page import Page
from support.log_samples import write
from support.robots.steered_hand import hands

import hoap3
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.report.motion import read_motion
from hoap3.tools.analysis.report.motion_plots import motion_drawings
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.services.configs import load_controller_config
from hoap3.tools.view.steering.hold import braking_distance

UP, ASIDE = np.array([0.0, 0.0, 0.06]), np.array([0.0, 0.05, 0.0])
T = 0.001


class Operator:
    """Sends a point, a chunk from another place, and a point again; notes where the target is."""

    def __init__(self) -> None:
        self.number, self.grant, self.places = 0, {}, {}

    def __call__(self, loop) -> None:
        if not loop.epoch:
            return
        tick = loop.last_tick
        (live,) = loop._controller.live
        where, rate = np.zeros(3), np.zeros(3)
        live.at(tick * T, where, rate)
        self.places[tick] = where
        if tick % 500 == 0 or not self.grant:
            self.grant = loop.operate("acquire", "me")
        home = self.places[min(self.places)]
        points = {
            300: [home + UP],
            900: [home + UP + ASIDE * i / 8 for i in range(9)],
            1500: [home],
        }.get(tick)
        if points is not None:
            self.number += 1
            made = Target(len(points), 3)
            made.number, made.first_tick, made.tick_step = self.number, tick, 50
            made.session_id, made.epoch = self.grant["session_id"], self.grant["epoch"]
            made.values[:] = np.ravel(points)
            loop.steer("me", made.dump())


@pytest.fixture(scope="module")
def steered(tmp_path_factory):
    """The log of a hand that was steered, and where its target was at each tick."""
    operator = Operator()
    done = hoap3.simulate("ur5", "steered_ur5", 2.0, steer=operator)
    folder, log = tmp_path_factory.mktemp("steered"), done.log
    settings, _ = load_controller_config("steered_ur5")
    attachments = {
        "description.json": log.payloads(Kind.DESCRIPTION)[0],
        "config.yaml": settings.model_dump_json().encode(),
    }
    write(folder / "controller.mcap", log.records, side="controller", attachments=attachments)
    return read_motion(Sources.open(folder)), operator, done


def test_the_target_is_where_the_controller_had_it_at_each_tick(steered):
    motion, operator, done = steered
    assert (motion.point, motion.frame) == ("tool0", hoap3.load_robot("ur5").base_frame)
    active = done.states[done.states["mode"] == State.ACTIVE]
    assert motion.path_m == pytest.approx(hands(active["q"]), abs=1e-12)
    where = np.array([operator.places[tick] for tick in active["tick"].tolist()])
    braked = braking_distance(0.125, 0.99, 19.8)  # behind the last point of the chunk
    assert np.ptp(where, axis=0) == pytest.approx([0.0, 0.05 + braked, 0.06], abs=1e-5)
    assert motion.target_m == pytest.approx(where, abs=1e-9)


def test_it_is_in_the_plots_and_in_space_with_its_path_up_to_each_moment(steered):
    motion = steered[0]
    drawings = {each.name: each for each in motion_drawings(motion)}
    assert {"views", "path", "tracking"} <= drawings.keys()
    for name in ("views", "path"):
        assert any(key.role == "red" and key.mark == "line" for key in drawings[name].keys)
    views = Page(drawings["views"].svg).root.all("svg")
    red = [len(view.all("path", "c-red")) for view in views]  # a cross, and the path to it
    assert (red[0], red[-1]) == (1, 2)


def test_without_the_controllers_log_there_is_none(steered):
    motion = replace(steered[0], target_m=None)
    assert "tracking" not in {each.name for each in motion_drawings(motion)}
