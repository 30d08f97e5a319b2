"""Motion and contact against their laws in plain numpy.

The rule: 1e-10, relative to 1 + the largest entry. Forces of contacts are those that their law
asks for at the velocity they lead to: 1e-10 times κ, which is 1 + the largest slope of the law
along the contacts' mobility, since by so much a residual exceeds an error of the force.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.robot_emulator.plants import contact_kernels, motion_kernels
from hoap3.robot_emulator.plants import plants_reference as plain

SEEDS = seed_ranges(300, 1100, 5300)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)


def near(found: np.ndarray, expected: np.ndarray, factor: float = 1.0) -> None:
    within = 1e-10 * factor * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


@many
def test_joints_move_by_constant_accelerations_and_by_euler(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, dt = int(rng.integers(1, 9)), 10.0 ** rng.uniform(-3, -1)
        q, dq, ddq = rng.normal(size=(3, n)) * [[1.0], [3.0], [30.0]]
        lower, upper = -rng.random(n), rng.random(n)
        for exact, reference in ((True, plain.accelerated), (False, plain.advanced)):
            place, speed = q.copy(), dq.copy()
            motion_kernels.advance(ddq, dt, exact, lower, upper, place, speed)
            expected = reference(q, dq, ddq, dt, lower, upper)
            near(place, expected[0])
            near(speed, expected[1])


@many
def test_servos_encoders_and_friction(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, dt = int(rng.integers(1, 9)), 10.0 ** rng.uniform(-3, -1)
        command, place, shown, dq = rng.normal(size=(4, n))
        share = float(rng.choice([1.0, rng.random()]))
        counts = rng.choice([0.0, 1e3, 3e4], n)
        expected = plain.served(command, share, dt, counts, place, shown)
        there, q, rate = place.copy(), shown.copy(), np.empty(n)
        motion_kernels.serve(command, share, dt, counts, there, q, rate)
        for found, wanted in zip((there, q, rate), expected, strict=True):
            near(found, wanted)

        viscous, coulomb = rng.exponential(size=(2, n))
        B, torque, sliding = np.empty(n), np.empty(n), rng.random()
        motion_kernels.joint_friction(dq, viscous, coulomb, sliding, B, torque)
        for found, wanted in zip(
            (B, torque), plain.friction(dq, viscous, coulomb, sliding), strict=True
        ):
            near(found, wanted)

        lower, upper, kept = -rng.random(n), rng.random(n), np.empty(n)
        first = motion_kernels.clamp(dq, lower, upper, kept)
        np.testing.assert_array_equal(kept, np.clip(dq, lower, upper))
        assert first == next(iter(np.flatnonzero(kept != dq)), -1)


@many
def test_points_of_bodies_their_depths_and_their_rows(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, b, c = int(rng.integers(1, 8)), int(rng.integers(1, 4)), int(rng.integers(1, 5))
        bases = np.linalg.qr(rng.normal(size=(b + c, 3, 3)))[0]
        places = np.concatenate([bases[:b], rng.normal(size=(b, 3, 1))], axis=2)
        axes, carriers = bases[b:].copy(), rng.integers(0, b, c)
        offsets, levels, joints = (
            rng.normal(size=(c, 3)),
            rng.normal(size=c),
            rng.normal(size=(6, n)),
        )
        points, depths, rows = np.empty((c, 3)), np.empty(c), np.zeros((c, 3, n))
        touching = contact_kernels.touch(places, carriers, offsets, axes, levels, points, depths)
        assert touching == (depths > 0.0).sum()
        order, movers = rng.permutation(n), rng.random((c, n)) < 0.6
        contact_kernels.contact_rows(joints, order, movers, axes, points, rows)
        for i in range(c):
            point, depth = plain.touched(places[carriers[i]], offsets[i], axes[i], levels[i])
            near(points[i], point)
            near(depths[i], np.array(depth))
            near(rows[i], plain.contact_rows(joints[:, order], movers[i], axes[i], point))


@many
def test_contacts_push_as_their_law_asks_where_they_lead(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, c, h = int(rng.integers(3, 8)), int(rng.integers(1, 3)), 1e-3
        half = rng.normal(size=(n, n))
        M, J = half @ half.T + np.eye(n), rng.normal(size=(c, 3, n))
        depths = np.where(rng.random(c) < 0.8, 1.0, -1.0) * 10.0 ** rng.uniform(-5, -2, c)
        laws = np.column_stack(
            [10.0 ** rng.uniform(2, 5, c), 10.0 ** rng.uniform(0, 2, c), rng.uniform(0, 1, c)]
        )
        order, (dq, free) = rng.permutation(n), rng.normal(size=(2, n))
        there = np.zeros((n, n))
        there[np.ix_(order, order)] = M
        forces, ddq = np.zeros((c, 3)), free.copy()
        L, halves, W = np.zeros((n, n)), np.zeros((c, 3, n)), np.zeros((c, c, 3, 3))
        contact_kernels.push(
            np.triu(there), order, J, depths, laws, dq, h, L, halves, W, forces, ddq
        )
        expected, accelerations = plain.answered(forces, M, J, depths, laws, dq, free, h)
        mobility = h * np.abs(np.einsum("cri,ij,dsj", J, np.linalg.inv(M), J)).max()
        damping = np.maximum(laws[:, 1], h * laws[:, 0])
        slope = damping.max() + (laws[:, 2] * np.abs(forces[:, 0])).max() / plain.CREEP
        near(forces, expected, 1.0 + mobility * slope)
        near(ddq, accelerations)


@many
def test_forces_at_a_velocity_and_what_a_sensor_feels(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, c, h = int(rng.integers(1, 8)), int(rng.integers(1, 5)), 1e-3
        J, dq, depths = rng.normal(size=(c, 3, n)), rng.normal(size=n), rng.normal(size=c)
        laws, forces, torque = rng.random((c, 3)) * [100.0, 10.0, 1.0], np.ones((c, 3)), np.ones(n)
        contact_kernels.react(J, depths, laws, dq, h, forces, torque)
        rows = zip(depths, J @ dq, laws, strict=True)
        expected = np.array([plain.law(depth, v, *each, h) for depth, v, each in rows])
        near(forces, expected)
        near(torque, np.einsum("cri,cr->i", J, expected))

        bases = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(c + 2)]
        body, mount = (np.column_stack([Q, rng.normal(size=3)]) for Q in bases[:2])
        points, axes = rng.normal(size=(c, 3)), np.array(bases[2:])
        felt, wrench, share = rng.random((1, c)) < 0.7, rng.normal(size=6), rng.random()
        before = wrench.copy()
        contact_kernels.sense(
            *(body[None], np.zeros(1, np.int64), mount[None], felt, points, axes, forces),
            *(share, wrench),
        )
        origin, R = body[:, :3] @ mount[:, 3] + body[:, 3], body[:, :3] @ mount[:, :3]
        whole = np.einsum("cri,cr->ci", axes, forces) * felt.T
        near(wrench - before, share * plain.sensed(points, whole, origin, R))
