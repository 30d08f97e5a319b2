"""The cascade and the weights: what is wrong with their levels, bounds and weights."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import quadprog
from support.solvers.one_shot import hqp, weighted

from hoap3.protocol.errors import InfeasibleError


class TestCascade:
    def test_dependent_and_zero_rows_do_no_harm(self):
        J = [np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 0]]), np.eye(3)]
        qdd, _ = hqp(J, [[1, 1, 5], [9, 2, 3]], np.eye(3), np.zeros(3), 1e-8)
        np.testing.assert_allclose(qdd, [1, 2, 3], atol=1e-6)

    def test_levels_can_be_shared_and_reordered(self):
        J, b = [np.eye(2)[:1], np.eye(2)[:1], np.eye(2)[1:]], [[0.0], [2.0], [1.0]]
        rest = np.eye(2), np.zeros(2), 1e-9
        np.testing.assert_allclose(hqp(J, b, *rest, levels=[[0, 1], [2]])[0], [1, 1], atol=1e-6)
        np.testing.assert_allclose(hqp(J, b, *rest, levels=[[1], [0, 2]])[0], [2, 1], atol=1e-6)

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
