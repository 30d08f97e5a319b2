"""Distances between links and from obstacles: against Coal, differences, and in motion."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from constraint_bench import PERIOD, ROBOTS, Bench, differences, hoap3, posture, small
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from protocol.errors import ConfigError
from remote_controller.constraints.bodies import Body, Box, Capsule, Sphere, links

SEEDS = st.integers(0, 2**32 - 1)
BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
POLE = {
    "name": "pole",
    "shape": "capsule",
    "ends_m": [[0.2, -0.3, 0.0], [0.25, 0.3, 0.5]],
    "radius_m": 0.02,
}
TABLE = {
    "name": "table",
    "shape": "box",
    "center_m": [0.4, 0.1, 0.2],
    "size_m": [0.3, 0.5, 0.1],
    "rpy_rad": [0.1, -0.2, 0.4],
}
WORLD = [BALL, POLE, TABLE]
POLE_BESIDE = {
    "name": "pole",
    "shape": "capsule",
    "ends_m": [[0.15, 0.0, 0.1], [0.15, 0.0, 0.9]],
    "radius_m": 0.03,
}


def distance(**settings_given: object) -> dict[str, object]:
    return {"constraint": "distance", **settings_given}


def core(body: Body) -> tuple[object, float]:
    """A body for Coal, which knows boxes, capsules and spheres."""
    if np.count_nonzero(body.half) > 1:
        return coal.Box(*(2 * body.half)), 0.0
    if body.half.any():
        return coal.Capsule(body.radius, 2 * body.half[2]), 0.0
    return coal.Sphere(body.radius), 0.0


def by_coal(bench: Bench, first: Body, second: Body) -> float:
    placed = []
    for body in (first, second):
        position, rotation = np.zeros(3), np.zeros((3, 3))
        frames = (bench.kinematics.frame_id(name) for name in (body.frame, "r_sole"))
        bench.kinematics.frame(*frames, position, rotation, np.zeros((6, bench.robot.n)))
        center = position + rotation @ body.center
        placed += [core(body)[0], coal.Transform3s(rotation @ body.axes, center)]
    result = coal.DistanceResult()
    return float(coal.distance(*placed, coal.DistanceRequest(), result))


def test_margins_are_coals_distances_less_the_clearance():
    bench = Bench(hoap3(), distance(obstacles=WORLD, clearance_m=0.01, activation_m=10.0))
    bodies = links(hoap3())
    obstacles = {
        each["name"]: kind.model_validate(each).body("r_sole")
        for each, kind in zip(WORLD, (Sphere, Capsule, Box), strict=True)
    }
    apart = 0
    for seed in range(4):
        margins = bench.margins(posture(hoap3(), seed))
        for name, margin in zip(bench.only.margin_names, margins, strict=True):
            first, second = name.split(" to ")
            expected = by_coal(bench, bodies[first].as_capsule(), {**bodies, **obstacles}[second])
            if expected > 1e-6:
                assert margin == pytest.approx(expected - 0.01, abs=1e-6), name
                apart += 1
            else:
                assert margin <= -0.01 + 1e-6, name
    assert apart > 700


@pytest.mark.parametrize("activation", [1e-6, 0.02, 0.3])
@settings(max_examples=8)
@given(seed=SEEDS)
def test_margins_are_exact_where_they_are_small_and_never_too_large(activation, seed):
    q = posture(hoap3(), seed)
    exact = Bench(hoap3(), distance(obstacles=WORLD, activation_m=10.0)).margins(q).copy()
    bench = Bench(hoap3(), distance(obstacles=WORLD, activation_m=activation))
    margins = bench.margins(q)
    near = exact < activation
    np.testing.assert_array_equal(margins[near], exact[near])
    assert np.all(margins[~near] >= activation)
    assert np.all(margins <= exact + 1e-12)
    assert bench.only.margin() == exact.min()


@settings(max_examples=25)
@given(seed=SEEDS)
def test_the_nearest_point_is_nearest_of_many_samples(seed):
    """A segment and a box, both anywhere: no sampled pair of points is nearer, some are as near."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.5, 0.5, (2, 3))
    size, center = rng.uniform(0.02, 0.6, 3), rng.uniform(-0.3, 0.3, 3)
    box = {"name": "box", "shape": "box", "center_m": center, "size_m": size, "frame": "base"}
    rod = {"name": "rod", "shape": "capsule", "ends_m": ends, "radius_m": 0.01, "frame": "base"}
    obstacles = [
        {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in each.items()
        }
        for each in (box, rod)
    ]
    bench = Bench(small(), distance(obstacles=obstacles, pairs=[["rod", "box"]], obstacle_links=[]))
    assume(bench.only.margin_names == ("rod to box",))
    s = np.linspace(0.0, 1.0, 4001)[:, None]
    outside = np.abs(ends[0] + s * (ends[1] - ends[0]) - center) - size / 2
    sampled = np.linalg.norm(np.maximum(outside, 0.0), axis=1).min() - 0.02
    if sampled > -0.02:
        assert sampled - 1e-3 <= bench.stack.margin() <= sampled + 1e-12
    else:
        assert bench.stack.margin() <= -0.02
        assert bench.only.events["crossing"] >= 1


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("obstacle", WORLD, ids=lambda each: each["name"])
@settings(max_examples=8)
@given(seed=SEEDS)
def test_the_first_row_is_the_derivative_of_the_margin(name, obstacle, seed):
    robot = ROBOTS[name]()
    link = {"hoap3": "r_forearm", "small": "fore"}[name]
    bench = Bench(
        robot,
        distance(pairs=[], obstacles=[obstacle], obstacle_links=[link], activation_m=9.0),
    )
    q = posture(robot, seed)
    expected, finer = differences(bench, q), differences(bench, q, 1e-7)
    bench.at(q)
    assume(bench.only.margins[0] > -0.04)  # apart: elsewhere the nearest face may change
    assume(np.abs(expected - finer).max() < 1e-6)  # no kink within the step
    np.testing.assert_allclose(-bench.stack.A[0], expected[0], atol=2e-6)


@settings(max_examples=15)
@given(seed=SEEDS)
def test_between_two_moving_links_too(seed):
    bench = Bench(hoap3(), distance(pairs=[["l_forearm", "r_forearm"]], activation_m=9.0))
    q = posture(hoap3(), seed)
    expected, finer = differences(bench, q), differences(bench, q, 1e-7)
    bench.at(q)
    assume(bench.only.margins[0] > -0.01)
    assume(np.abs(expected - finer).max() < 1e-6)
    np.testing.assert_allclose(-bench.stack.A[0], expected[0], atol=2e-6)


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
    for _ in range(600):
        bench.at(bench.state.reference + PERIOD * u)
        following = bench.nearest(np.array(wanted))
        jump = max(jump, float(np.abs(following - u).max()))
        least, u = min(least, bench.stack.constraints[1].margin()), following
    assert least >= -1e-6
    assert jump < 0.1
    assert least < 2e-3  # it did come near


AT_HAND = [  # around the right hand of the start posture, at (0.116, -0.129, 0.162) m
    {**BALL, "center_m": [0.12, -0.22, 0.16]},
    {**POLE, "ends_m": [[0.19, -0.2, 0.2], [0.19, 0.0, 0.2]]},
    {**TABLE, "center_m": [0.1, -0.25, 0.2], "size_m": [0.3, 0.1, 0.3]},
]


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
        {"constraint": "joint_speed", "limit_rad_s": 1.0},
        {"constraint": "joint_position"},
        distance(obstacles=scene, clearance_m=0.0, eta_per_s=20.0),
    )
    rng, least, nearest = np.random.default_rng(1), np.inf, np.inf
    for _ in range(600):
        wanted = 0.2 * rng.normal(size=21)
        wanted[:6] = wanted[10:16] = 0.0
        wanted[6:10] += 5.0 * aim.at(bench.state.reference).stack.A[0, 6:10]
        bench.at(bench.state.reference + PERIOD * bench.nearest(wanted))
        least = min(least, bench.stack.margin())
        nearest = min(nearest, aim.only.margins[0] + 0.01)
    assert least >= -1e-6
    assert nearest < 2e-3
    assert bench.stack.events() == {}


def test_only_pairs_that_are_near_have_rows():
    bench = Bench(hoap3(), distance(obstacles=WORLD, activation_m=0.01))
    near = np.count_nonzero(bench.only.margins < 0.01)
    written = np.count_nonzero(np.isfinite(bench.stack.b))
    assert near <= written <= 3 * near
    assert 0 < near < len(bench.only.margins)
    used = bench.stack.A.any(axis=1)
    np.testing.assert_array_equal(used, np.isfinite(bench.stack.b))


def test_with_too_few_rows_the_nearest_pairs_have_them():
    short = Bench(hoap3(), distance(rows=9, activation_m=0.05))
    assert short.only.events["rows_short"] > 0
    closest = np.sort(short.only.margins)[0]
    rows = short.stack.b[np.isfinite(short.stack.b)]
    assert 1 <= len(rows) <= 9
    assert rows.min() == pytest.approx(10.0 * (closest - 1e-5))


@pytest.mark.parametrize("clearance", [2.0, 1e6])
def test_with_more_pairs_deep_inside_than_rows_the_deepest_has_them(clearance):
    pairs = [["head", "r_foot"], ["head", "l_foot"], ["r_forearm", "l_foot"], ["pelvis", "r_foot"]]
    bench = Bench(hoap3(), distance(pairs=pairs, clearance_m=clearance, rows=3))
    assert (bench.only.margins < -1.0).all()
    assert bench.only.events["rows_short"] == 3
    rows = bench.stack.b[np.isfinite(bench.stack.b)]
    assert 1 <= len(rows) <= 3
    assert np.isfinite(bench.stack.A).all()
    assert not np.isnan(bench.stack.b).any()


def test_the_links_that_the_initial_posture_has_together_are_no_automatic_pair():
    assert Bench(hoap3(), distance()).stack.margin() > 0.0
    names = Bench(hoap3(), distance(clearance_m=0.0)).only.margin_names
    assert len(names) >= len(Bench(hoap3(), distance()).only.margin_names)
    assert not any("pelvis" in name and "trunk" in name for name in names)
    assert any({"r_forearm", "l_forearm"} == set(name.split(" to ")) for name in names)


def test_from_inside_a_ball_the_rows_lead_out_at_the_limited_rate():
    body = links(small())["fore"]
    ball = {"name": "ball", "shape": "sphere", "center_m": [0.02, 0.0, 0.5], "radius_m": 0.05}
    bench = Bench(
        small(),
        distance(
            pairs=[], obstacles=[ball], obstacle_links=["fore"], clearance_m=0.0, eta_per_s=20.0
        ),
    )  # fmt: skip
    bench.stack.reset()
    bench.at(np.array([0.3, -0.3, 0.0]))
    start = bench.stack.margin()
    assert -0.08 < start < -body.radius / 2
    assert bench.stack.b.min() == -0.05
    assert bench.only.events["started_outside"] >= 1
    before = start
    for _ in range(1500):
        bench.walk(np.zeros(3), 1)
        now = bench.stack.margin()
        assert before - 1e-6 <= now <= before + 0.05 * PERIOD + 1e-5
        before = now
    assert now >= -1e-3


def test_cores_that_cross_are_counted_and_finite():
    stake = {"name": "stake", "shape": "box", "center_m": [0, 0, 0.45], "size_m": [0.3, 0.3, 0.02]}
    bench = Bench(small(), distance(pairs=[], obstacles=[stake], obstacle_links=["fore"]))
    bench.at(np.zeros(3))
    assert bench.only.events["crossing"] >= 1
    assert bench.stack.margin() < 0.0
    assert np.isfinite(bench.stack.A).all()
    assert bench.stack.b.min() == -0.05 or bench.only.events["immovable"] > 0


@example(gap=0.0)
@given(gap=st.floats(-1e-12, 1e-12))
@settings(max_examples=10)
def test_touching_is_no_jump(gap):
    """The straight arm's fore capsule has radius 0.03, the ball 0.05 beside its axis."""
    ball = {"name": "ball", "shape": "sphere", "center_m": [0.08 + gap, 0, 0.5], "radius_m": 0.05}
    bench = Bench(
        small(), distance(pairs=[], obstacles=[ball], obstacle_links=["fore"], clearance_m=0.0)
    )
    bench.at(np.zeros(3))
    assert bench.stack.margin() == pytest.approx(gap, abs=1e-15)
    assert abs(bench.stack.b[0]) <= 1e-10
    np.testing.assert_allclose(bench.stack.A[0], [0.3, 0.1, 0.0], atol=1e-9)


def test_a_box_becomes_the_capsule_along_its_longest_side():
    thigh = links(hoap3())["r_thigh"].as_capsule()
    np.testing.assert_allclose(thigh.half, [0.0, 0.0, 0.0375])
    assert thigh.radius == pytest.approx(0.0375)
    forearm = links(hoap3())["r_forearm"].as_capsule()
    np.testing.assert_allclose(forearm.axes[:, 2], [1.0, 0.0, 0.0])
    assert forearm.radius == pytest.approx(0.03)
    assert forearm.half[2] + forearm.radius == pytest.approx(0.105)
    assert np.linalg.det(forearm.axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"pairs": [["r_forearm", "l_forarm"]]}, r"pairs\.0.*Did you mean 'l_forearm'"),
        ({"pairs": [["r_forearm", "r_forearm"]]}, r"pairs\.0: is no pair"),
        ({"obstacles": [{**BALL, "name": "head"}]}, r"obstacles\.0\.name: is taken"),
        ({"obstacles": [BALL, BALL]}, r"obstacles\.1\.name: is taken"),
        ({"obstacles": [{**BALL, "frame": "flor"}]}, r"obstacles\.0\.frame: .*no such frame"),
        ({"obstacles": [{**BALL, "radius_m": -1.0}]}, r"obstacles\.0\.radius_m"),
        ({"obstacles": [{**BALL, "shape": "cone"}]}, r"obstacles\.0"),
        ({"obstacles": [BALL], "obstacle_links": ["nose"]}, r"obstacle_links\.0"),
        ({"rows": 2}, r"rows"),
    ],
)
def test_wrong_settings_are_named(entry, words):
    with pytest.raises(ConfigError, match=words):
        Bench(hoap3(), distance(**entry))
