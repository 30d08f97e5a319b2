"""Distances of a robot with mimic joints: the rows of the same robot let go, folded by its law."""

from __future__ import annotations

import numpy as np
import pytest
from support.constraint_bench import AccelerationBench, Bench, differences, posture
from support.robots.following_arm import following, let_go
from support.robots.full_model import FullModel

SHELF = {
    "name": "shelf",
    "shape": "box",
    "center_m": [0.2, 0.25, 0.75],
    "size_m": [0.3, 0.1, 0.3],
    "rpy_rad": [0.1, 0.2, 0.3],
}
ENTRY = {
    "constraint": "distance",
    "joints_apart": 1,
    "obstacles": [SHELF],
    "activation_m": 0.4,
    "contact_m": 0.4,
    "spread_m": 0.05,
    "reserve_m": 0.0,
    "eta_per_s": 2.0,
}
SEEDS = range(8)
PER_SPEED_SQUARED = 4.0 * 64.0 * 2.0**-52 / 1e-10 + 1e-4
"""By how much m̈ may differ at a speed of 1, which is a second difference over ε = 10 µrad: margins
are known to 64 units in the last place of 1 m, so m̈ to 4 such errors over ε²; and the robots differ
in ε, ε·|m⃛|/3, with m⃛ ≤ 30/m² for cores 3 cm apart."""


def law():
    """G and g₀ of the joints of `let_go`, in its order."""
    plain = FullModel(following())
    names = let_go().joint_names
    order = [plain.model.joints[plain.model.getJointId(name)].idx_v for name in names]
    return plain.G[order], plain.g0[order]


def both(bench):
    """Bodies of either robot, held to the same pairs: those that are apart where both start."""
    robot, (G, g0) = following(), law()
    start = {"initial_posture": "bent", "postures": {"bent": tuple(robot.initial_position)}}
    free = let_go().model_copy(
        update={**start, "postures": {"bent": tuple(G @ robot.initial_position + g0)}}
    )
    ours, theirs = bench(robot, ENTRY), bench(free, ENTRY)
    assert ours.only.margin_names == theirs.only.margin_names
    return ours, theirs, G, g0


def test_rows_of_velocities_are_those_of_the_robot_let_go():
    ours, theirs, G, g0 = both(Bench)
    seen = 0
    for seed in SEEDS:
        q = posture(following(), seed)
        ours.at(q)
        theirs.at(G @ q + g0)
        np.testing.assert_allclose(ours.only.margins, theirs.only.margins, atol=1e-12)
        np.testing.assert_allclose(ours.stack.A, theirs.stack.A @ G, atol=1e-11)
        np.testing.assert_allclose(ours.stack.b, theirs.stack.b, atol=1e-10)
        seen += int(np.isfinite(ours.stack.b).sum())
    assert seen > 100


def test_the_nearest_row_of_a_pair_is_the_gradient_of_its_margin():
    bench = Bench(following(), {**ENTRY, "spread_m": 1e-6})
    near = 0
    for seed in SEEDS:
        q = posture(following(), seed)
        coarse, fine = differences(bench, q), differences(bench, q, 1e-7)
        margins = bench.margins(q)
        smooth = np.abs(coarse - fine).max(axis=1) < 1e-6
        for row, bound in zip(bench.stack.A, bench.stack.b, strict=True):
            of_pairs = np.flatnonzero(np.abs(margins * 2.0 - bound) < 1e-9)  # b = η·m
            if len(of_pairs) == 1 and smooth[of_pairs[0]] and bound > 0.0:
                np.testing.assert_allclose(-row, fine[of_pairs[0]], atol=1e-5)
                near += 1
    assert near > 20


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_rows_of_accelerations_are_those_of_the_robot_let_go(speed):
    """Their right-hand sides, too: J̇·dq of the bodies is that of all joints at G·dq."""
    ours, theirs, G, g0 = both(AccelerationBench)
    seen = 0
    for seed in SEEDS:
        q = posture(following(), seed)
        dq = speed * np.random.default_rng(seed).normal(size=following().n)
        ours.at(q, dq)
        theirs.at(G @ q + g0, G @ dq)
        np.testing.assert_allclose(ours.stack.rows, theirs.stack.rows @ G, atol=1e-11)
        mine, right = ours.stack.rows_upper, theirs.stack.rows_upper
        np.testing.assert_array_equal(np.isfinite(mine), np.isfinite(right))
        known = np.isfinite(mine)
        near = 1e-9 + PER_SPEED_SQUARED * np.abs(G @ dq).max() ** 2
        np.testing.assert_allclose(mine[known], right[known], atol=near)
        seen += int(known.sum())
    assert seen > 100
