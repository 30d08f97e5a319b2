"""Pushed onto a link or an obstacle, a robot stops, without tilting into it and without chatter."""

from __future__ import annotations

import numpy as np
import pytest
from distance_scenes import BALL, POLE, POLE_BESIDE, TABLE, distance
from support.constraint_bench import PERIOD, Bench, hoap3, small


@pytest.mark.parametrize("tilt", [0.0, 1e-15, -1e-15, 1e-9, -1e-9, 1e-6, -1e-6])
def test_parallel_capsules_give_one_answer_whichever_way_they_tilt(tilt):
    bench = Bench(
        small(),
        distance(obstacles=[POLE_BESIDE], obstacle_links=["fore"], clearance_m=0.0, eta_per_s=10.0),
    )
    bench.at(np.array([tilt, -tilt / 2, 0.0]))
    assert bench.stack.margin() == pytest.approx(0.09, abs=1e-5)
    bench = Bench(
        small(),
        distance(
            obstacles=[POLE_BESIDE], obstacle_links=["fore"], clearance_m=0.08, eta_per_s=10.0
        ),
    )
    bench.at(np.array([tilt, -tilt / 2, 0.0]))
    assert np.isfinite(bench.stack.A).all()
    assert not np.isnan(bench.stack.b).any()
    for wanted in ([1.0, 0.0, 0.0], [-1.0, 3.0, 0.0], [1.0, -3.0, 0.0]):
        straight = Bench(
            small(),
            distance(
                obstacles=[POLE_BESIDE], obstacle_links=["fore"], clearance_m=0.08, eta_per_s=10.0
            ),
        ).at(np.zeros(3))
        one, other = bench.nearest(np.array(wanted)), straight.nearest(np.array(wanted))
        np.testing.assert_allclose(one, other, atol=1e-3)


@pytest.mark.parametrize("wanted", [[1.0, 0, 0], [0, 1.0, 0], [-1.0, 3.0, 0], [1.0, -2.5, 0.5]])
def test_pushed_onto_a_parallel_capsule_it_neither_tilts_into_it_nor_chatters(wanted):
    """Speeds settle: their changes from tick to tick stay small once the limit is felt."""
    bench = Bench(
        small(),
        {"constraint": "joint_position"},
        distance(
            pairs=[], obstacles=[POLE_BESIDE], obstacle_links=["fore", "hand"], clearance_m=0.005,
            eta_per_s=20.0, activation_m=0.2,
        ),
    ).at(np.zeros(3))  # fmt: skip
    u = bench.nearest(np.array(wanted))
    least, jump = np.inf, 0.0
    for _ in range(900):
        bench.at(bench.state.reference + PERIOD * u)
        following = bench.nearest(np.array(wanted))
        jump = max(jump, float(np.abs(following - u).max()))
        least, u = min(least, bench.stack.constraints[1].margin()), following
    assert least >= -1e-6
    assert jump < 0.1
    assert least < 3e-3  # it did come near


AT_HAND = [  # around the right hand of the start posture, at (0.116, -0.129, 0.162) m
    {**BALL, "center_m": [0.12, -0.22, 0.16]},
    {**POLE, "ends_m": [[0.19, -0.2, 0.2], [0.19, 0.0, 0.2]]},
    {**TABLE, "center_m": [0.1, -0.25, 0.2], "size_m": [0.3, 0.1, 0.3]},
]


@pytest.mark.slow
@pytest.mark.parametrize("other", ["trunk", "r_thigh", "ball", "pole", "table"])
def test_an_arm_of_hoap3_pushed_onto_something_stops_and_keeps_every_distance(other):
    scene = [each for each in AT_HAND if each["name"] == other]
    pairs = [] if scene else [["r_forearm", other]]
    aim = Bench(
        hoap3(),
        distance(pairs=pairs, obstacles=scene, obstacle_links=["r_forearm"], activation_m=9.0),
    )
    bench = Bench(
        hoap3(),
        {"constraint": "joint_velocity", "limit_rad_s": 1.0},
        {"constraint": "joint_position"},
        distance(obstacles=scene, clearance_m=0.0, eta_per_s=20.0),
    )
    rng, least, nearest = np.random.default_rng(1), np.inf, np.inf
    for _ in range(900):
        wanted = 0.2 * rng.normal(size=21)
        wanted[:6] = wanted[10:16] = 0.0
        wanted[6:10] += 5.0 * aim.at(bench.state.reference).stack.A[0, 6:10]
        bench.at(bench.state.reference + PERIOD * bench.nearest(wanted))
        least = min(least, bench.stack.margin())
        nearest = min(nearest, aim.only.margins[0] + 0.01)
    assert least >= -1e-6
    assert nearest < 2e-3
    assert bench.stack.events() == {}
