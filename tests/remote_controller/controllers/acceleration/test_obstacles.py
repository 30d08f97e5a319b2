"""A ball and a wall that hierarchies keep: against quadprog, and in lockstep."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import quadprog
from hierarchy_runs import PLACES, robot, state_of
from obstacle_runs import RANKED, avoiding

from hoap3.protocol.config.settings import parse
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.acceleration.problem import SOLVED
from hoap3.tools.simulate import Simulation, simulate

RUNS = [(place, name) for place in PLACES for name in RANKED]
STATES = 840  # of each run: 5,040 in all
TOLERANCE = 1e-6  # of the greatest acceleration
RANK = 1e-9  # of the greatest singular value


@cache
def run(place: str, name: str, seconds: float) -> Simulation:
    return simulate(PLACES[place], avoiding(place, name), seconds)


def made(place: str, name: str):
    """The controller of a run, anew."""
    config = parse(ControllerConfig, avoiding(place, name), name)
    controller = build(config, robot(PLACES[place]), name)
    controller.now = lambda: 0
    return controller


def sides(controller) -> tuple[np.ndarray, np.ndarray]:
    """G, h with G q̈ ≥ h, rows of length 1: bounds, torques, constraints."""
    dynamics, stack, one = controller.tasks.dynamics, controller.stack, np.eye(controller.ddq.size)
    rows = np.vstack([one, dynamics.mass, stack.rows])
    most = controller.torque_max
    lower = np.concatenate([controller.lower, -most - dynamics.bias, stack.rows_lower])
    upper = np.concatenate([controller.upper, most - dynamics.bias, stack.rows_upper])
    G, h = np.vstack([rows, -rows]), np.concatenate([lower, -upper])
    length = np.linalg.norm(G, axis=1)
    given = np.isfinite(h) & (length > 0.0)
    return G[given] / length[given, None], h[given] / length[given]


def pieces(controller) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """J_i and b_i of all tasks, and of what brakes."""
    tasks = controller.tasks
    (jacobian, wanted), m = tasks.with_rest, len(tasks.wanted)
    places = [*tasks.rows, slice(m, None)]
    return [jacobian[each] for each in places], [wanted[each] for each in places]


def beyond(A: np.ndarray, size: float) -> np.ndarray:
    """Orthonormal columns that A annihilates."""
    _, s, Vt = np.linalg.svd(A)
    return Vt[int((s > RANK * size).sum()) :].T


def by_weights(controller) -> np.ndarray:
    """(12): one program of all tasks."""
    (J, b), M, w = pieces(controller), controller.tasks.dynamics.mass, controller.w_r
    H, f = w * np.eye(len(M)) + w * M.T @ M, w * b[-1]
    for weight, A, e in zip(controller.importance.value, J[:-1], b[:-1], strict=True):
        H, f = H + weight * A.T @ A, f + weight * A.T @ e
    G, h = sides(controller)
    return quadprog.solve_qp(H, f, G.T, h)[0]


def by_levels(controller) -> np.ndarray:
    """Level by level: each does what it can in what those above leave."""
    (J, b), (G, h), w = pieces(controller), sides(controller), controller.w_r
    ddq, Z, slack = np.zeros(G.shape[1]), np.eye(G.shape[1]), 0.0
    for level in [*controller.levels, [len(J) - 1]]:
        if Z.shape[1] == 0:
            break
        A, e = np.vstack([J[i] for i in level]), np.concatenate([b[i] for i in level])
        H = (A @ Z).T @ (A @ Z) + w * np.eye(Z.shape[1])
        f = (A @ Z).T @ (e - A @ ddq)
        length = np.linalg.norm(G @ Z, axis=1)
        moved = length > RANK  # sides that this level can still move
        sides_left = (G @ Z)[moved] / length[moved, None], (h - slack - G @ ddq)[moved]
        z = quadprog.solve_qp(H, f, sides_left[0].T, sides_left[1] / length[moved])[0]
        ddq, slack = ddq + Z @ z, max(1e-8, 1.01 * slack)  # quadprog needs room behind a side
        Z = Z @ beyond(A @ Z, np.linalg.norm(A, 2))
    return ddq


def by_projectors(controller) -> np.ndarray:
    """(13), all x_i unknown; of strict priorities P_i projects out of what stands above."""
    (J, b), M, w = pieces(controller), controller.tasks.dynamics.mass, controller.w_r
    n, k, alpha = len(M), len(J), controller.alpha
    assert set(np.unique(alpha)) <= {0.0, 1.0}
    P = []
    for i in range(k):
        above = [J[j] for j in range(k) if alpha[i, j] == 1.0]
        A = np.vstack([np.zeros((1, n)), *above])
        N = beyond(A, max(np.linalg.norm(A, 2), 1e-300))
        P.append(N @ N.T)
    whole = np.hstack(P)
    H, f = w * np.eye(k * n) + w * (M @ whole).T @ (M @ whole), np.zeros(k * n)
    for i in range(k):
        own = slice(i * n, i * n + n)
        H[own, own] += J[i].T @ J[i]
        f[own] = J[i].T @ b[i]
    G, h = sides(controller)
    return whole @ quadprog.solve_qp(H, f, (G @ whole).T, h)[0]


PLAIN = {"ghc": by_projectors, "hqp": by_levels, "weighted": by_weights}


@pytest.mark.parametrize(
    ("seconds", "count"), [(0.3, 30), pytest.param(2.0, STATES, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(("place", "name"), RUNS)
def test_the_answer_is_that_of_a_plain_program_along_the_motion(place, name, seconds, count):
    """At states of the run that have an answer, many of which ball or wall hold."""
    controller, done = made(place, name), run(place, name, seconds)
    answered = np.flatnonzero(done.setpoints["fallback"] == SOLVED)
    held = 0
    for tick in answered[np.linspace(0, answered.size - 1, count).astype(int)]:
        seen = done.states[tick]
        command = controller.step(state_of(controller, seen["q"], seen["dq"], int(tick)))
        assert command.fallback == SOLVED
        expected = PLAIN[name](controller)
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(controller.ddq, expected, rtol=0, atol=TOLERANCE * size)
        held += controller.stack.held(controller.ddq) > 0
    assert held >= 0.2 * count or seconds < 1.0


@pytest.mark.parametrize("seconds", [0.3, pytest.param(2.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("place", "name"), RUNS)
def test_ball_and_wall_are_kept_though_targets_lie_behind(place, name, seconds):
    done = run(place, name, seconds)
    margins = done.setpoints["margin"]
    assert margins.min() >= -done.controller.margin_tolerance == -1e-6
    assert set(done.setpoints["fallback"]) <= {0, 4}
    if seconds > 1.0:
        ball, _ = done.controller.stack.constraints
        assert ball.margin() < 1e-3  # the hand came to it
