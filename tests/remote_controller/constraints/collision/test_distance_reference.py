"""Distances of rounded boxes and their rows against hulls of corners in plain numpy.

The rule: 1e-10 m, and 1e-10 of 1 + the largest entry of rows. Pairs are 1 mm apart or more, as
nearer ones have a direction that rounding decides; of those that cross only the sign is compared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.constraints.collision import distance_curvature_kernels as curved
from hoap3.remote_controller.constraints.collision import distance_kernels as kernels
from hoap3.remote_controller.constraints.collision import distance_reference as plain

APART = 1e-3
SEEDS = seed_ranges(120, 220, 720)
PAIRS = 10  # of each seed


def near(found: np.ndarray, expected: np.ndarray) -> None:
    within = 1e-10 * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


def rotations(rng: np.random.Generator, count: int, turned: np.ndarray) -> np.ndarray:
    """Where `turned`; else the axes of all are the same."""
    Q = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    Q *= np.linalg.det(Q)[:, None, None]
    return np.where(turned[:, None, None], Q, np.eye(3))


class Scene(NamedTuple):
    """What `distance_rows` takes, and the corners of the bodies in the root, (B, 8, 3)."""

    frames: tuple[np.ndarray, np.ndarray]
    joints: tuple[np.ndarray, np.ndarray]
    bodies: tuple[np.ndarray, ...]
    pairs: np.ndarray
    carried: np.ndarray
    corners: np.ndarray

    def around(self, p: int) -> float:
        return float(self.bodies[4][self.pairs[p, :2]].sum())

    def closest(self, p: int) -> tuple[np.ndarray, np.ndarray]:
        return plain.closest(*self.corners[self.pairs[p, :2]])


def scene(rng: np.random.Generator) -> Scene:
    """Spheres, capsules and boxes on moving frames, ten pairs of them."""
    n, B = int(rng.integers(2, 9)), 2 * PAIRS
    origins = rng.uniform(-0.2, 0.2, (4, 3))
    turns = rotations(rng, 4, rng.random(4) < 0.7)
    halves, radii = rng.uniform(0.02, 0.2, (B, 3)), rng.uniform(0.0, 0.05, B)
    kinds = rng.integers(0, 3, B)
    kinds[::2] = np.minimum(kinds[::2], kinds[1::2])  # who has no edges comes first
    halves[kinds < 2, :2] = halves[kinds == 0, 2] = 0.0
    frame_of = rng.integers(0, 4, B)
    centers = rng.uniform(-0.3, 0.3, (B, 3))
    axes = rotations(rng, B, rng.random(B) < 0.7)
    balls = np.linalg.norm(halves, axis=1) + radii
    pairs = np.arange(B).reshape(-1, 2)
    pairs = np.column_stack([pairs, kinds[::2] == 2]).astype(np.int64)
    placed = zip(frame_of, centers, axes, halves, strict=True)
    corners = [
        plain.corners(origins[f] + turns[f] @ c, turns[f] @ R, half) for f, c, R, half in placed
    ]
    return Scene(
        (origins, turns),
        (rng.normal(size=(6, n)), rng.permutation(n)),
        (frame_of, centers, axes, halves, radii, balls),
        pairs,
        rng.integers(-1, 2, (PAIRS, n)).astype(float),
        np.array(corners),
    )


def settings(rng: np.random.Generator, activation: float) -> np.ndarray:
    """Clearance, activation, spread, η, reserve, speed of a return, contact."""
    eta, speed = 10.0 ** rng.uniform(0, 2), 10.0 ** rng.uniform(-2, 1)
    clearance = rng.uniform(0.0, 0.2)
    return np.array([clearance, activation, 5e-4, eta, 1e-5, speed, activation])


def measured(it: Scene, given: np.ndarray) -> tuple[np.ndarray, ...]:
    """Margins, A, b and contacts by the kernel, and how many pairs cross."""
    n, rows = it.joints[1].size, 4 * PAIRS
    margins, A, b = np.empty(PAIRS), np.empty((rows, n)), np.empty(rows)
    contacts = np.empty((rows, 9))
    told = kernels.distance_rows(
        *(*it.frames, *it.joints, *it.bodies, it.pairs, it.carried, given),
        *(margins, A, b, contacts),
    )
    return margins, A, b, contacts, told


@pytest.mark.slow
@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_margins_and_rows_are_those_of_the_nearest_points(seeds):
    known = crossing = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        it, given = scene(rng), settings(rng, 10.0)
        margins, A, b, contacts, (least, short, crossed, _) = measured(it, given)
        joints = it.joints[0][:, it.joints[1]]
        assert (least, short) == (margins.min(), 0)
        inside = 0
        for p in range(PAIRS):
            x, y = it.closest(p)
            apart = float(np.linalg.norm(x - y))
            if apart < APART:
                inside += margins[p] + it.around(p) + given[0] <= 0.0
                continue
            known += 1
            margin = apart - it.around(p) - given[0]
            near(margins[p], margin)
            own = np.flatnonzero(contacts[:, kernels.PAIR] == p)
            assert (1 if it.carried[p].any() else 0) <= own.size <= 4
            for row in own:  # each of a point of one body and what is nearest to it on the other
                point, n = contacts[row, 1:4], contacts[row, 4:7]
                ends = [plain.closest(point[None], it.corners[i]) for i in it.pairs[p, :2]]
                ways = [float(np.linalg.norm(a - c)) for a, c in ends]
                side = int(np.argmin(ways))
                assert ways[side] < 1e-7
                near(contacts[row, kernels.CORES_THERE], ways[1 - side])
                a, c = ends[1 - side]
                away = (a - c if side == 0 else c - a) / ways[1 - side]
                near(n, away)
                near(A[row], plain.row(point, away, joints, it.carried[p]))
                there = ways[1 - side] - it.around(p) - given[0]
                near(b[row], plain.bound(there, *given[3:6]))
            if own.size:  # the first is of the nearest points themselves
                near(contacts[own[0], kernels.MARGIN], margin)
                near(contacts[own[0], 4:7], (x - y) / apart)
        assert inside == crossed
        crossing += crossed
    assert known > 0.8 * PAIRS * len(seeds)
    assert crossing > 0.01 * PAIRS * len(seeds)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_far_margins_are_never_too_large_and_the_least_is_exact(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        it, given = scene(rng), settings(rng, 0.05)
        margins, looked = measured(it, given)[0], np.empty(PAIRS)
        curved.distance_margins(*it.frames, *it.bodies, it.pairs, given, looked)
        np.testing.assert_array_equal(margins, looked)
        points = [it.closest(p) for p in range(PAIRS)]
        apart = np.array([np.linalg.norm(x - y) for x, y in points])
        exact = apart - [it.around(p) for p in range(PAIRS)] - given[0]
        assert np.all(margins <= exact + 1e-10)
        near_ones = (apart > APART) & (exact < given[1])
        near(margins[near_ones], exact[near_ones])
        if apart[margins.argmin()] > APART:
            near(margins.min(), exact.min())


@pytest.mark.slow
@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_accelerations_are_those_of_the_margins_and_of_the_points_that_face(seeds):
    measured_ones = facing = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        it, given = scene(rng), settings(rng, 10.0)
        margins, A, _, contacts, _ = measured(it, given)
        joints, order = it.joints
        eps = 10.0 ** rng.uniform(-4, -2) if seed % 5 else 0.0
        looks = margins + np.array([[0.0], [1.0], [1.0]]) * eps * rng.normal(size=(3, PAIRS))
        dq, upper = rng.normal(size=order.size), np.empty(len(A))
        curved.distance_accelerations(
            *(contacts, joints, order, it.carried, dq, looks, eps, given, A, upper)
        )
        for row, (p, margin) in enumerate(contacts[:, [kernels.PAIR, kernels.MARGIN]]):
            if p < 0.0:
                assert upper[row] == np.inf
                continue
            pair, rate, n = int(p), -A[row] @ dq, contacts[row, 4:7]
            if margin <= margins[pair] + curved.NEAREST:
                bend = plain.curvature(*looks[:, pair], rate, eps) if eps else 0.0
                measured_ones += 1
            else:
                carried = np.empty(order.size)
                places = np.empty(order.size)
                carried[order], places[order] = it.carried[pair], dq
                reach = contacts[row, kernels.CORES_THERE] * n
                point, args = contacts[row, 1:4], (n, joints, places, carried)
                bend = min(
                    plain.facing(np.array([point, point - reach]), *args),
                    plain.facing(np.array([point + reach, point]), *args),
                )
                facing += 1
            eta, bounded = given[3], plain.bound(float(margin), *given[3:6])
            bend = bend if eps else 0.0  # nothing moves
            size = np.array([eta * rate, eta * bounded, bend])
            near(np.append(size, upper[row]), np.append(size, size @ [2.0, 1.0, 1.0]))
    assert min(measured_ones, facing) > PAIRS * len(seeds) // 4
