"""The plain program, the cascade and the weights: what `ghc` is compared with."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import quadprog
from hierarchy_problems import hierarchy, violation
from support.oracles.plain_lqp import PlainLqp, friction_rows, lqp

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError
from hoap3.remote_controller.solvers import ghc, hqp, weighted
from hoap3.remote_controller.solvers.base.task_validation import stacked


def test_the_plain_program_equals_the_condensed_one():
    same = refused = gave_up = 0
    for seed in range(200):
        it = hierarchy(seed)
        try:
            found = lqp(*it.arguments, **it.options)
        except InfeasibleError:
            assert violation(it) > 1e-10, seed
            refused += 1
            continue
        except SolverError:
            gave_up += 1
            continue
        for ours, right in zip(ghc(*it.arguments, **it.options), found, strict=True):
            assert np.abs(ours - right).max() < 1e-6 * (1 + np.abs(right).max()), seed
        same += 1
    assert same > 80
    assert refused > 10
    assert gave_up < 10


class TestContacts:
    """A floating body of 3 + 2 coordinates on the ground, pushed."""

    n = 5

    def tasks(self, push: float):
        J = [np.eye(self.n)[:3], np.eye(self.n)]
        weight = np.array([0, 0, 9.81, 0, 0.0])
        return stacked("test", J, [[push, 0, 0], np.zeros(self.n)], np.eye(self.n), weight)

    def robot(self, **rows) -> PlainLqp:
        contact = np.zeros((3, self.n))
        contact[:, :3] = np.eye(3)
        contact[:, 3:] = 0.1
        return PlainLqp(self.n, S=np.eye(self.n)[3:], contact=contact, **rows)

    def solve(self, push: float, mu: float = 0.5, **more):
        F = friction_rows([0, 0, 2], mu)
        G = np.hstack([np.zeros((len(F), self.n)), F, np.zeros((len(F), 2))])
        alpha = [[0, 0], [1, 0]]
        robot = self.robot(G=G, h=np.zeros(len(G)))
        return robot.solve(self.tasks(push), alpha, 1e-4, "torque", **more), robot

    def test_forces_stay_within_the_cone_and_satisfy_the_equation_of_motion(self):
        for push in (1.0, 20.0):
            it, robot = self.solve(push)
            weight = np.array([0, 0, 9.81, 0, 0])
            pushed = robot.contact.T @ it.wrench + robot.S.T @ it.tau
            np.testing.assert_allclose(it.qdd, pushed - weight, rtol=0, atol=1e-7)
            assert it.wrench[2] > 0
            assert np.hypot(*it.wrench[:2]) <= 0.5 * it.wrench[2] + 1e-7

    def test_a_push_beyond_friction_is_cut_off(self):
        gentle, strong = self.solve(1.0)[0], self.solve(20.0)[0]
        assert gentle.qdd[0] == pytest.approx(1, abs=1e-2)
        assert strong.qdd[0] < 19
        assert strong.wrench[0] > 0.3 * strong.wrench[2]

    def test_rows_hold_accelerations_and_wrenches(self):
        G = np.zeros((2, self.n + 5))
        G[0, 0] = G[1, self.n + 2] = 1
        it = self.robot(G=G, h=[0.3, 5.0]).solve(self.tasks(1.0), [[0, 0], [1, 0]], 1e-4, "torque")
        assert it.qdd[0] <= 0.3 + 1e-7
        assert it.wrench[2] <= 5 + 1e-7

    def test_contradictory_rows_are_infeasible(self):
        G = np.zeros((2, self.n + 5))
        G[0, 0], G[1, 0] = 1, -1
        with pytest.raises(InfeasibleError):
            self.robot(G=G, h=[-1.0, 0.5]).solve(self.tasks(1.0), np.zeros((2, 2)), 1e-4)

    def test_what_does_not_fit_is_named(self):
        with pytest.raises(BadProblemError, match="no contact"):
            self.robot().solve(self.tasks(1.0), np.zeros((2, 2)), 1e-2, "none")
        with pytest.raises(BadProblemError, match="G has shape"):
            PlainLqp(3, G=np.eye(3), h=np.zeros(3))
        with pytest.raises(BadProblemError, match="alpha has shape"):
            self.robot().solve(self.tasks(1.0), np.zeros((3, 3)), 1e-2)
        with pytest.raises(BadProblemError, match="normal"):
            friction_rows([0, 0, 0], 1.0)


def test_the_pyramid_lies_within_the_cone():
    rng = np.random.default_rng(0)
    F = friction_rows([1, 2, 3], 0.7, 6)
    up = np.array([1, 2, 3]) / np.sqrt(14)
    inside = 0
    for force in rng.normal(size=(2000, 3)):
        if (F @ force <= 0).all():
            inside += 1
            press = force @ up
            assert np.linalg.norm(force - press * up) <= 0.7 * press + 1e-12
    assert inside > 50


class TestCascade:
    def test_equals_ghc_at_the_top_and_where_all_tasks_are_feasible(self):
        rng = np.random.default_rng(1)
        n, w = 9, 1e-8
        J = [rng.normal(size=(3, n)) for _ in range(2)]
        b = [rng.normal(size=3) for _ in J]
        qdd, _ = hqp(J, b, np.eye(n), np.zeros(n), w)
        for each, wanted in zip(J, b, strict=True):
            np.testing.assert_allclose(each @ qdd, wanted, atol=1e-6)
        top, _ = ghc(J, b, [[0, 0], [1, 0]], np.eye(n), np.zeros(n), w, regularise="none")
        np.testing.assert_allclose(J[0] @ top, J[0] @ qdd, atol=1e-6)

    def test_equals_a_cascade_of_programs_with_the_upper_levels_as_equations(self):
        rng = np.random.default_rng(2)
        compared = 0
        for _ in range(60):
            n, w = 6, 1e-3
            J = [rng.normal(size=(2, n)) for _ in range(3)]
            b = [3 * rng.normal(size=2) for _ in J]
            root = rng.normal(size=(n, n))
            M, bias, reach = root @ root.T + np.eye(n), rng.normal(size=n), 1.5
            options = {"qdd_lower": np.full(n, -reach), "qdd_upper": np.full(n, reach)}
            qdd, tau = hqp(J, b, M, bias, w, **options)
            np.testing.assert_allclose(tau, M @ qdd + bias)
            assert np.abs(qdd).max() < reach + 1e-6
            x = np.zeros(n)
            sides = np.vstack([np.eye(n), -np.eye(n)])
            for level in range(3):
                upper = np.vstack([np.zeros((0, n)), *J[:level]])
                H = J[level].T @ J[level] + w * np.eye(n)
                edge = reach + 1e-6 * level  # quadprog calls what is just feasible inconsistent
                room = np.concatenate([-edge - x, -edge + x])
                e = J[level].T @ (b[level] - J[level] @ x)
                rows = np.vstack([upper, sides])
                least = np.concatenate([np.zeros(len(upper)), room])
                x = x + quadprog.solve_qp(H, e, rows.T, least, len(upper))[0]
            np.testing.assert_allclose(qdd, x, rtol=0, atol=1e-3)
            compared += bool(np.abs(qdd).max() > reach - 1e-6)
        assert compared > 20

    def test_dependent_and_zero_rows_do_no_harm(self):
        J = [np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 0]]), np.eye(3)]
        qdd, _ = hqp(J, [[1, 1, 5], [9, 2, 3]], np.eye(3), np.zeros(3), 1e-8)
        np.testing.assert_allclose(qdd, [1, 2, 3], atol=1e-6)

    def test_levels_can_be_shared_and_reordered(self):
        J, b = [np.eye(2)[:1], np.eye(2)[:1], np.eye(2)[1:]], [[0.0], [2.0], [1.0]]
        rest = np.eye(2), np.zeros(2), 1e-9
        np.testing.assert_allclose(hqp(J, b, *rest, levels=[[0, 1], [2]])[0], [1, 1], atol=1e-6)
        np.testing.assert_allclose(hqp(J, b, *rest, levels=[[1], [0, 2]])[0], [2, 1], atol=1e-6)
        for wrong in ([[0], [0]], [[3]], [[]], []):
            with pytest.raises(BadProblemError, match="levels must"):
                hqp(J, b, *rest, levels=wrong)

    def test_bounds_that_contradict_are_infeasible(self):
        with pytest.raises(InfeasibleError):
            hqp(
                [np.eye(2)],
                [[0, 0]],
                np.eye(2),
                np.zeros(2),
                1e-3,
                qdd_lower=[1, 1],
                tau_upper=[0, 9],
            )


class TestWeights:
    def test_equals_quadprog_and_is_never_exactly_strict(self):
        rng = np.random.default_rng(3)
        n, w = 4, 1e-3
        J = [rng.normal(size=(3, n)), rng.normal(size=(3, n))]
        b = [rng.normal(size=3) for _ in J]
        M, bias = 2 * np.eye(n), rng.normal(size=n)
        errors = []
        for ratio in (0.1, 1, 10, 100):
            qdd, tau = weighted(J, b, [ratio, 1], M, bias, w, tau_upper=bias + 0.5)
            H = ratio * J[0].T @ J[0] + J[1].T @ J[1] + w * np.eye(n) + w * M.T @ M
            f = ratio * J[0].T @ b[0] + J[1].T @ b[1]
            x = quadprog.solve_qp(H, f, -M.T, np.full(n, -0.5))[0]
            np.testing.assert_allclose(qdd, x, atol=1e-9)
            np.testing.assert_allclose(tau, M @ qdd + bias)
            errors.append(np.linalg.norm(J[0] @ weighted(J, b, [ratio, 1], M, bias, w)[0] - b[0]))
        assert all(a > b > 1e-4 for a, b in pairwise(errors))

    def test_bad_input(self):
        rest = np.eye(2), np.zeros(2), 1e-3
        with pytest.raises(BadProblemError, match="weights has shape"):
            weighted([np.eye(2)], [[0, 0]], [1, 1], *rest)
        with pytest.raises(BadProblemError, match="must not be negative"):
            weighted([np.eye(2)], [[0, 0]], [-1], *rest)
