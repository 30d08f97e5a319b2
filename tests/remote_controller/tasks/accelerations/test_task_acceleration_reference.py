"""What tasks ask of accelerations and velocities against plain numpy.

The rule: 1e-10, relative to 1 + the largest entry, up to 3 rad from a goal: at half a turn the
logarithm has two values.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from support.amounts import AMOUNTS, seed_ranges
from support.oracles.tsid_oracle import desired_acceleration

from hoap3.remote_controller.controllers.acceleration import joint_acceleration_kernels as postures
from hoap3.remote_controller.controllers.acceleration.torque_rows_kernels import torque_rows
from hoap3.remote_controller.controllers.velocity import velocity_task_stack_kernels as velocities
from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels
from hoap3.remote_controller.tasks.accelerations import task_acceleration_reference as plain
from hoap3.remote_controller.tasks.se3_reference import cross_matrix, homogeneous

SEEDS = seed_ranges(200, 1000, 5200)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
SIZES = {kernels.POSITION: 3, kernels.POSE: 6, kernels.GIVEN: 2, kernels.ROOT_POSE: 6}


def near(found: object, expected: object) -> None:
    within = 1e-10 * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


def turned(rng: np.random.Generator, most: float) -> np.ndarray:
    axis = rng.normal(size=3)
    return expm(cross_matrix(axis * rng.uniform(0.0, most) / np.linalg.norm(axis)))


@many
def test_each_task_asks_for_its_acceleration_and_v_for_its_fall(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, k, T = int(rng.integers(1, 9)), int(rng.integers(1, 5)), 10.0 ** rng.uniform(-3, -1)
        kinds = rng.integers(0, 5, k)
        sizes = np.array([SIZES.get(int(kind), n) for kind in kinds])
        firsts, m = np.cumsum(sizes) - sizes, int(sizes.sum())
        tasks = np.column_stack([kinds, firsts, sizes, np.arange(k)]).astype(np.int64)
        q, dq, ddq = rng.normal(size=(3, n))
        targets, origins = rng.normal(size=(k, 3, 3)), rng.normal(size=(k, 3))
        R = np.array([turned(rng, 3.0) for _ in range(k)])
        goals = np.array([turned(rng, 3.0) @ each for each in R])
        twist, drift, posture, error, motion, rate = rng.normal(size=(6, m))
        given, joints = [each.copy() for each in (error, motion, rate)], rng.integers(0, n, m)
        gains, slope, wanted = rng.exponential(size=(k, 2)), rng.normal(size=m), np.empty(m)
        own = slope.copy()
        opposite = kernels.desired_accelerations(
            *(tasks, origins, R, twist, drift, targets, goals, posture, joints, gains, q, dq),
            *(np.empty((3, 3)), error, motion, rate, slope, wanted),
        )
        assert opposite == 0
        J, tops = rng.normal(size=(m, n)), rng.random(k) < 0.7
        expected = np.zeros(3)
        for i, (kind, first, size, _) in enumerate(tasks):
            rows = slice(first, first + size)
            e, nu, nu_rate = (each[rows].copy() for each in given)
            if kind == kernels.POSTURE:
                e, nu, nu_rate = posture[rows] - q[joints[rows]], dq[joints[rows]], 0.0 * e
            if kind == kernels.POSE:
                H, goal = homogeneous(R[i], origins[i]), homogeneous(goals[i], targets[i, 0])
                e, nu, nu_rate = (
                    desired_acceleration(H, goal, nu, 0, 0)[0],
                    twist[rows],
                    drift[rows],
                )
            if kind in {kernels.POSITION, kernels.ROOT_POSE}:
                place = slice(first, first + 3)
                e, nu, nu_rate = plain.position(targets[i], origins[i], twist[place], drift[place])
            if kind == kernels.ROOT_POSE:
                angular = slice(first + 3, first + 6)
                e = np.hstack([e, plain.orientation(R[i], goals[i])])
                nu, nu_rate = np.hstack([nu, twist[angular]]), np.hstack([nu_rate, drift[angular]])
            near(error[rows], e)
            near(motion[rows], nu)
            near(rate[rows], nu_rate)
            near(wanted[rows], plain.wanted(e, nu, nu_rate, *gains[i]))
            if kind == kernels.GIVEN:
                np.testing.assert_array_equal(slope[rows], own[rows])
            elif kind != kernels.POSE:
                near(slope[rows], -e)
            if tops[i]:
                expected += plain.predicted(e, nu, nu_rate, slope[rows], J[rows] @ ddq, T)
        norms = np.empty(k)
        found = kernels.predict_lyapunov(
            tasks, tops, J, error, motion, rate, slope, dq, ddq, T, norms
        )
        near(found[:3], expected)
        assert found[3] == (np.abs(dq + T * ddq) >= kernels.ACTIVE_SPEED).sum()
        near(norms, [np.linalg.norm(error[f : f + s]) for f, s in zip(firsts, sizes, strict=True)])


@many
def test_targets_in_frames_and_loads_of_joints(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, s, T = int(rng.integers(1, 9)), int(rng.integers(0, 3)), 10.0 ** rng.uniform(-3, -1)
        place, velocity, later, origin = rng.normal(size=(4, 3))
        axes, out = turned(rng, 3.0), np.empty((3, 3))
        kernels.place_in_root(place, velocity, later, T, origin, axes, out)
        near(out, plain.in_root(place, velocity, later, T, origin, axes))

        M, J, w = rng.normal(size=(n, n)), rng.normal(size=(6 * s, n)), rng.normal(size=6 * s)
        h, dq, damping, tau, ddq = rng.normal(size=(5, n))
        most, mass, bias = rng.exponential(size=n) + 0.1, M.copy(), h.copy()
        worst = kernels.add_friction_and_wrenches(J, w, damping, dq, T, most, mass, bias)
        expected = plain.loaded(M, h, J, w, damping, dq, T)
        near(mass, expected[0])
        near(bias, expected[1])
        near(worst, (np.abs(expected[1]) / most).max())

        lower, upper, greatest = -rng.exponential(size=n), rng.exponential(size=n), np.ones(n)
        away = np.minimum(ddq - lower, upper - ddq)
        share = (np.abs(tau) / most).max()
        found = kernels.distances(ddq, tau, lower, upper, greatest, most, np.empty(n))
        near(found[:2], [min(1.0, away.min(), 1.0 - share), share])
        assert found[2] == (away.min() <= 1e-9)


@many
def test_rows_of_velocities_are_stacked_and_answers_are_cut(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        m, n = rng.integers(1, 9, 2)
        (e, rate), J, share = rng.normal(size=(2, m)), rng.normal(size=(m, n)), rng.random()
        missing, away, rows = np.empty(m), np.empty(m), np.empty((m, n))
        near(velocities.stack(e, rate, J, missing, away, rows), np.linalg.norm(e))
        np.testing.assert_array_equal(np.column_stack([missing, away]), -np.array([e, rate]).T)
        np.testing.assert_array_equal(rows, J)

        dq, out = rng.normal(size=n), np.empty(n)
        lower, upper = np.sort(rng.normal(size=(2, n)), axis=0)
        margin = velocities.cut(dq, share, lower, upper, out)
        np.testing.assert_array_equal(out, np.clip(share * dq, lower, upper))
        near(margin, np.minimum(out - lower, upper - out).min())


@many
def test_joints_go_to_a_posture_within_bounds(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, T = int(rng.integers(1, 12)), 10.0 ** rng.uniform(-3, -1)
        (q, dq, goal), (kp, kd) = rng.normal(size=(3, n)), rng.exponential(size=2)
        bounds, scale = np.sort(rng.normal(size=(2, n)), axis=0), rng.exponential(size=n) + 0.1
        ddq, place, speed = np.empty((3, n))
        V, rate, growth, active, margin, resting = postures.accelerate_to(
            q, dq, goal, kp, kd, *bounds, scale, T, ddq, place, speed
        )
        wanted = plain.to_posture(q, dq, goal, kp, kd, tuple(bounds))
        near(ddq, wanted)
        near(place, q + T * dq + 0.5 * T**2 * wanted)
        near(speed, dq + T * wanted)
        end = 0.5 * (place - goal) @ (place - goal)
        near(V, 0.5 * (q - goal) @ (q - goal))
        near(np.array([rate, growth]) * T, np.array([(q - goal) @ (place - q), end - V]))
        near(margin, min(1.0, (np.minimum(wanted - bounds[0], bounds[1] - wanted) / scale).min()))
        assert (active, resting) == ((np.abs(speed) >= postures.ACTIVE_SPEED).sum(), False)

        sent, before, applied = goal, q.copy(), goal.copy()
        applied[0] += rng.integers(2)  # it did what was sent, or something else
        state, moving, elapsed = q.copy(), dq.copy(), float(rng.integers(2)) * T
        assert postures.follow_reference(applied, before, sent, state, elapsed, moving)
        other = elapsed > 0.0 and bool((applied != sent).any())
        near(moving, (applied - q) / elapsed if other else dq)
        np.testing.assert_array_equal([state, before], [applied, applied])


@many
def test_torques_move_tasks_by_j_over_m(seeds):
    """To 1e-10 where κ(M) ≤ 1e4, as it is here."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        m, n = rng.integers(1, 9, 2)
        Q, J, out = (
            np.linalg.qr(rng.normal(size=(n, n)))[0],
            rng.normal(size=(m, n)),
            np.empty((m, n)),
        )
        M = (Q * 10.0 ** rng.uniform(-2, 2, n)) @ Q.T
        assert torque_rows(J, 0.5 * (M + M.T), np.empty((n, n)), out)
        near(out, plain.torque_rows(J, M))
