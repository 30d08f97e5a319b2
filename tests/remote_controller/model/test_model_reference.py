"""Kinematics and frame dynamics against 6 × 6 matrices, on random twists of joints.

The rule: 1e-10, relative to 1 + the largest entry: nothing is inverted.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.model.frame_dynamics_kernels import frames_dynamics
from hoap3.remote_controller.model.kinematics_kernels import com_in_frame, frame_in_frame
from hoap3.remote_controller.model.model_reference import (
    com_in_frame as plain_com,
)
from hoap3.remote_controller.model.model_reference import (
    frame_in_frame as plain_frame,
)
from hoap3.remote_controller.model.model_reference import frame_motion

SEEDS = seed_ranges(300, 1100, 5300)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)


def near(found: np.ndarray, expected: np.ndarray) -> None:
    within = 1e-10 * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


def rotation(rng: np.random.Generator) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.linalg.det(Q)


@many
def test_the_centre_of_mass_seen_from_a_frame(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        joints, com_jacobian = rng.normal(size=(6, n)), rng.normal(size=(3, n))
        com, origin, moment = rng.normal(size=(3, 3))
        moved, order = rng.random(n) < 0.5, rng.permutation(n)
        R, share = rotation(rng), rng.random()
        found, jacobian = np.zeros(3), np.zeros((3, n))
        com_in_frame(
            com_jacobian, joints, com, origin, R, moved, moment, share, order, found, jacobian
        )
        whole, carried = share * com + moment, joints * moved
        position, J = plain_com(whole, share * com_jacobian, carried, origin, R)
        near(found, position)
        near(jacobian, J[:, order])


@many
def test_a_frame_seen_from_another_one(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        joints, (o, s) = rng.normal(size=(6, n)), rng.normal(size=(2, 3))
        moved, carried = rng.random((2, n)) < 0.5
        order, R, S = rng.permutation(n), rotation(rng), rotation(rng)
        p, SR, J = np.zeros(3), np.zeros((3, 3)), np.zeros((6, n))
        frame_in_frame(joints, o, R, moved, s, S, carried, order, p, SR, J)
        expected = plain_frame(joints, o, R, moved, (s, S, carried))
        near(p, expected[0])
        near(SR, expected[1])
        near(J, expected[2][:, order])


@many
def test_motion_of_frames_and_what_is_left_without_accelerations(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 10))
        joints, order, half = rng.normal(size=(6, n)), rng.permutation(n), rng.normal(size=(n, n))
        mass, bias, dq = np.triu(half @ half.T), rng.normal(size=n), rng.normal(size=n)
        R, origin, mount = rotation(rng), rng.normal(size=3), np.zeros((2, 3, 4))
        poses = np.hstack([R.T.ravel(), origin])[None]
        movers = np.flatnonzero(rng.random(n) < 0.8)
        movers = rng.permutation(movers)  # their order is that from the root outwards
        for k in range(2):
            mount[k] = np.column_stack([rotation(rng), rng.normal(size=3)])
        J, twist, drift = np.zeros((9, n)), np.zeros(9), np.zeros(9)
        M, h, origins, rotations = (
            np.zeros((n, n)),
            np.zeros(n),
            np.zeros((2, 3)),
            np.zeros((2, 3, 3)),
        )
        frames_dynamics(
            *(mass, bias, joints, poses, np.zeros(2, np.int64), mount, order),
            *(np.tile(movers, 2), np.array([0, movers.size, 2 * movers.size])),
            *(np.array([[0, 6], [6, 3]]), dq, M, h, J, twist, drift, origins, rotations),
        )
        near(M, (mass + np.triu(mass, 1).T)[np.ix_(order, order)])
        near(h, bias[order])
        for k, rows in enumerate((slice(0, 6), slice(6, 9))):
            near(origins[k], origin + R @ mount[k, :, 3])
            near(rotations[k], R @ mount[k, :, :3])
            columns = joints[:, order[movers]]
            expected = frame_motion(columns, dq[movers], origins[k], rotations[k], own_axes=k == 0)
            near(J[rows][:, movers], expected[0])
            near(twist[rows], expected[1])
            near(drift[rows], expected[2])
