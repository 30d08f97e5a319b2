"""Distances between links and from obstacles: against Coal and differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from coal_shapes import Scene
from distance_scenes import BALL, WORLD, distance
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.constraint_bench import PERIOD, Bench, hoap3, posture, small
from support.small_arm import arm

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.constraints.collision.collision_geometry import links

SEEDS = st.integers(0, 2**32 - 1)


def compare_with_coal(robot, seeds, **given):
    """Margins against Coal's distances of the shapes themselves; returns how many are apart."""
    bench = Bench(robot, distance(obstacles=WORLD, clearance_m=0.01, activation_m=10.0, **given))
    scene, found = Scene(robot, WORLD), []
    for seed in seeds:
        q = posture(robot, seed)
        margins = bench.margins(q)
        scene.at(q)
        for name, margin in zip(bench.only.margin_names, margins, strict=True):
            found.append((name, margin, scene.distance(*name.split(" to ")) - 0.01))
    return found


def test_margins_are_coals_distances_of_the_urdfs_own_shapes_less_the_clearance():
    apart = overlapping = 0
    for name, margin, expected in compare_with_coal(hoap3(), range(6)):
        if expected > -0.01 + 1e-6:
            assert margin == pytest.approx(expected, abs=1e-6), name
            apart += 1
        else:
            assert margin < -0.01 + 1e-6, name
            overlapping += 1
    assert apart > 900
    assert overlapping > 30


def test_what_stands_for_a_cylinder_is_never_further_than_the_cylinder():
    names = set()
    for name, margin, expected in compare_with_coal(small(), range(200), joints_apart=1):
        if "fore" in name:
            assert margin <= max(expected, -0.01) + 1e-6, name
            assert margin >= expected - 0.03 * math.sqrt(2.0) - 1e-6 or expected < 0.0, name
            names.add(name)
        elif expected > -0.01 + 1e-6:
            assert margin == pytest.approx(expected, abs=1e-6), name
    assert len(names) >= 3


@pytest.mark.slow
@settings(max_examples=60)
@given(seed=SEEDS)
def test_two_boxes_anywhere_are_as_far_apart_as_coal_says_or_overlap(seed):
    rng = np.random.default_rng(seed)
    boxes = [
        {
            "name": name,
            "shape": "box",
            "frame": "base",
            "center_m": rng.uniform(-0.3, 0.3, 3).tolist(),
            "size_m": rng.uniform(0.005, 0.6, 3).tolist(),
            "rpy_rad": (rng.uniform(-3, 3, 3) * rng.integers(0, 2)).tolist(),
        }
        for name in ("one", "other")
    ]
    bench = Bench(small(), distance(obstacles=boxes, pairs=[["one", "other"]], obstacle_links=[],
                                    clearance_m=0.0, activation_m=9.0))  # fmt: skip
    expected = Scene(small(), boxes).at(np.zeros(3)).distance("one", "other")
    if expected > 1e-6:
        assert bench.only.margins[0] == pytest.approx(expected, abs=1e-6)
        assert bench.only.events["crossing"] == 0
    elif expected < -1e-6:
        assert bench.only.margins[0] < 0.0
        assert bench.only.events["crossing"] >= 1


def test_every_shape_of_a_link_counts():
    urdf = small().urdf
    more = '<collision><geometry><sphere radius="0.07"/></geometry></collision></link>'
    end = urdf.index("</link>", urdf.index('<link name="hand">'))
    robot = arm(urdf=urdf[:end] + more + urdf[end + len("</link>") :], soles=small().soles)
    bench = Bench(robot, distance(obstacles=[BALL], pairs=[], obstacle_links=["hand"],
                                  clearance_m=0.0, activation_m=9.0))  # fmt: skip
    scene = Scene(robot, [BALL])
    nearer = set()
    for seed in range(20):
        q = posture(robot, seed)
        margins = bench.margins(q)
        assert len(margins) == 2
        assert margins.min() == pytest.approx(scene.at(q).distance("hand", "ball"), abs=1e-6)
        nearer.add(int(margins.argmin()))
    assert nearer == {0, 1}


@pytest.mark.slow
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


def test_only_pairs_that_are_near_have_rows():
    bench = Bench(hoap3(), distance(obstacles=WORLD, activation_m=0.01))
    near = np.count_nonzero(bench.only.margins < 0.01)
    written = np.count_nonzero(np.isfinite(bench.stack.b))
    assert near <= written <= 4 * near
    assert 0 < near < len(bench.only.margins)
    used = bench.stack.A.any(axis=1)
    np.testing.assert_array_equal(used, np.isfinite(bench.stack.b))


def balls(count, **given):
    """Balls on both sides of the upright arm, in pairs equally far; the furthest come first."""
    ends = [
        {**BALL, "name": f"ball {i}", "center_m": [(-1) ** i * (0.4 - 0.01 * (i // 2)), 0.0, 0.5]}
        for i in range(count)
    ]
    return Bench(
        small(),
        distance(pairs=[], obstacles=ends, obstacle_links=["fore"], activation_m=9.0, **given),
    ).at(np.zeros(3))


@pytest.mark.parametrize("rows", [3, 4, 5, 6, 7])
@pytest.mark.parametrize("clearance", [0.01, 5.0])
def test_with_too_few_rows_the_nearest_pairs_have_them_and_of_equal_ones_the_first(rows, clearance):
    every = balls(8, clearance_m=clearance)
    short = balls(8, clearance_m=clearance, rows=rows)
    assert every.only.events["rows_short"] == 0
    assert np.isfinite(every.stack.b).sum() == 8  # a row for each pair, in their order
    assert len(np.unique(every.only.margins)) == 4
    nearest = np.argsort(every.only.margins, kind="stable")[:rows]
    assert short.only.events["rows_short"] == 2 * (8 - rows)  # of the start, and here
    assert (
        (every.stack.A[0:8:2] != every.stack.A[1:8:2]).any(axis=1).all()
    )  # which one of equal ones it is shows
    np.testing.assert_array_equal(short.stack.A, every.stack.A[nearest])
    np.testing.assert_array_equal(short.stack.b, every.stack.b[nearest])


def test_two_boxes_have_four_rows_where_their_faces_are_parallel_and_the_first_is_the_nearest():
    lid = {"name": "lid", "shape": "box", "center_m": [0.2, 0, 0.7], "size_m": [0.1, 0.6, 0.6]}
    bench = Bench(
        small(),
        distance(pairs=[], obstacles=[lid], obstacle_links=["hand"], activation_m=1.0,
                 clearance_m=0.0),
    )  # fmt: skip
    bench.at(np.zeros(3))
    used = bench.stack.b[np.isfinite(bench.stack.b)]
    margin = bench.only.margins[0]
    assert margin == pytest.approx(0.15 - 0.02)
    np.testing.assert_allclose(used, 10.0 * (margin - 1e-5))
    assert len(used) == 4
    assert np.ptp(bench.stack.A[:4, 0]) == pytest.approx(0.15)  # the hand's whole length
    for tilt in (0.02, -0.02):
        bench.at(np.array([tilt, 0.0, 0.0]))
        assert bench.stack.b[0] == bench.stack.b.min()


@pytest.mark.parametrize("clearance", [2.0, 1e6])
def test_with_more_pairs_deep_inside_than_rows_the_deepest_has_them(clearance):
    pairs = [["head", "r_foot"], ["head", "l_foot"], ["r_forearm", "l_foot"], ["pelvis", "r_foot"]]
    bench = Bench(hoap3(), distance(pairs=pairs, clearance_m=clearance, rows=3))
    assert (bench.only.margins < -1.0).all()
    assert bench.only.events["rows_short"] == 3
    margins = bench.only.margins
    assert bench.stack.b[0] == max(10.0 * margins.min(), -0.05)
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


@pytest.mark.slow
def test_from_inside_a_ball_the_rows_lead_out_at_the_limited_rate():
    (body,) = links(small())["fore"]
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


@pytest.mark.parametrize(
    ("cylinder", "half", "radius"),
    [((0.03, 0.2), [0.0, 0.0, 0.1], 0.03), ((0.2, 0.05), [0.2, 0.2, 0.025], 0.0)],
)
def test_a_long_cylinder_is_in_a_capsule_and_a_flat_one_in_a_box(cylinder, half, radius):
    urdf = small().urdf.replace(
        'radius="0.03" length="0.2"', 'radius="{}" length="{}"'.format(*cylinder)
    )
    (body,) = links(arm(urdf=urdf, soles=small().soles))["fore"]
    np.testing.assert_allclose(body.half, half)
    assert body.radius == radius
    turn, share = np.random.default_rng(0).uniform(-math.pi, math.pi, (2, 100))
    rim = np.stack([np.cos(turn), np.sin(turn), share / math.pi], axis=1)
    rim *= [cylinder[0], cylinder[0], cylinder[1] / 2]
    out = np.maximum(np.abs(rim) - body.half, 0.0)
    assert (np.linalg.norm(out, axis=1) <= body.radius + 1e-12).all()


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"pairs": [["r_forearm", "l_forarm"]]}, r"pairs\.0.*'l_forearm'"),
        ({"pairs": [["r_forearm", "r_forearm"]]}, r"pairs\.0: "),
        ({"obstacles": [{**BALL, "name": "head"}]}, r"obstacles\.0\.name: "),
        ({"obstacles": [BALL, BALL]}, r"obstacles\.1\.name: "),
        ({"obstacles": [{**BALL, "frame": "flor"}]}, r"obstacles\.0\.frame: .*flor"),
        ({"obstacles": [BALL], "obstacle_links": ["nose"]}, r"obstacle_links\.0"),
    ],
)
def test_wrong_settings_are_named(entry, words):
    with pytest.raises(ConfigError, match=words):
        Bench(hoap3(), distance(**entry))
