"""The generalized projector against its closed form, and the projectors it replaces."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.oracles.plain_lqp import projected_sum
from support.solvers.one_shot import generalized_projector

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.ghc.projector_kernels import (
    Above,
    Basis,
    exact_basis,
    sort_tasks,
)
from hoap3.remote_controller.solvers.ghc.reference import null_space, projector

SEEDS = st.integers(0, 2**32 - 1)


def hard_case(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Duplicate, dependent, tiny, huge and zero rows; ties; more rows than columns."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 9), rng.integers(1, 15)
    J = rng.normal(size=(m, n))
    for row in range(m):
        kind, a, b = rng.integers(9), *rng.integers(m, size=2)
        if kind == 0:
            J[row] = rng.normal() * J[a]
        elif kind == 1:
            J[row] = J[a] - 2 * J[b]
        elif kind == 2:
            J[row] = 0
    J *= 10.0 ** (rng.uniform(-290, 100, size=(m, 1)) * (rng.random((m, 1)) < 0.2))
    return rng.choice([0, 0.25, 0.5, 1, rng.random()], size=m), J


@given(SEEDS)
def test_equals_the_closed_form_on_hard_cases(seed):
    alpha, J = hard_case(seed)
    P = generalized_projector(alpha, J)
    np.testing.assert_allclose(P, projector(alpha, J), rtol=0, atol=1e-9)


@given(SEEDS, st.sampled_from([0.0, 0.1, 1.0]))
def test_is_symmetric_with_eigenvalues_from_0_to_1(seed, smoothing):
    alpha, J = hard_case(seed)
    P = generalized_projector(alpha, np.clip(J, -9, 9), smoothing=smoothing)
    assert (P == P.T).all()
    found = np.linalg.eigvalsh(P)
    assert found.min() > -1e-12
    assert found.max() < 1 + 1e-12


@given(SEEDS)
def test_annihilates_strict_levels_whatever_stands_below(seed):
    alpha, J = hard_case(seed)
    top = alpha == alpha.max()
    left = J[top] @ generalized_projector(alpha, J) - (1 - alpha.max()) * J[top]
    assert np.abs(left).max() <= 1e-12 * np.abs(J[top]).max() * J.shape[1]


@given(SEEDS)
def test_neither_order_nor_length_of_rows_matters(seed):
    alpha, J = hard_case(seed)
    rng = np.random.default_rng(seed)
    order, lengths = rng.permutation(len(J)), np.exp(rng.normal(size=(len(J), 1)))
    shuffled = generalized_projector(alpha[order], (J * lengths)[order])
    np.testing.assert_allclose(generalized_projector(alpha, J), shuffled, rtol=0, atol=1e-9)


@given(SEEDS, st.integers(1, 5))
def test_is_continuous_in_priorities_that_overtake_each_other(seed, stages):
    """All priorities go elsewhere, crossing on their way: P changes by no more than they do."""
    _, J = hard_case(seed)
    rng = np.random.default_rng(seed)
    start, end = rng.choice([0, 0.5, 1], size=(2, len(J)))
    steps = 40 * stages
    path = [generalized_projector(start + s * (end - start), J) for s in np.linspace(0, 1, steps)]
    jumps = [np.linalg.norm(b - a, 2) for a, b in itertools.pairwise(path)]
    assert max(jumps) <= 2 * min(len(J), J.shape[1]) / (steps - 1)


def test_a_row_fades_out_as_its_own_priority_rises():
    J = np.random.default_rng(0).normal(size=(3, 5))
    for own in (0.0, 0.3, 1.0):
        P = generalized_projector([own, 0, 0], J)
        np.testing.assert_allclose(J[0] @ P, (1 - own) * J[0], atol=1e-12)


def test_a_network_of_priorities():
    """1▷2▷3, 4▷5▷6 and 2▷5, all else free: who keeps out of whose directions."""
    above = {1: [], 2: [1], 3: [1, 2], 4: [], 5: [4, 2, 1], 6: [4, 5, 2, 1]}
    J = np.random.default_rng(1).normal(size=(6, 9))
    for task, upper in above.items():
        alpha = np.array([1.0 if j in upper else 0.0 for j in range(1, 7)])
        P = generalized_projector(alpha, J)
        for j in range(1, 7):
            felt = np.abs(J[j - 1] @ P).max()
            assert (felt < 1e-12) if j in upper else (felt > 1e-2), (task, j)


def of_two_tasks(upper: np.ndarray, lower: np.ndarray) -> tuple[int, np.ndarray]:
    """The rank of all rows, and P of a third task: priorities 1 and 0.6 over it."""
    J, alpha = np.vstack([upper, lower]), np.array([1.0, 0.6])
    (m, n), closes, order = J.shape, np.zeros(2, np.int64), np.zeros(2, np.int64)
    count = sort_tasks(alpha, closes, np.zeros(2), order)
    above = Above(J, np.array([0, len(upper), m]), closes, alpha, order)
    basis = Basis(np.zeros((m + 1, n)), np.zeros(m), np.zeros(3, np.int64), np.zeros(m, np.int64))
    rank, c = exact_basis(above, count, 0, basis)
    B = basis.B[:rank]
    return rank, c * np.eye(n) - B.T * basis.D[:rank] @ B


def nearly_dependent(rng: np.random.Generator, share: float) -> tuple[np.ndarray, ...]:
    """Two tasks in 9 of 15 dimensions, and the orthonormal Q of which they are combinations.

    The upper task spans Q[:4], the lower one all. Only `share` of its first row is outside Q[:4],
    along Q[4]; it has 8 rows more than needed.
    """
    Q = np.linalg.qr(rng.normal(size=(15, 9)))[0].T
    upper, lower = np.eye(4, 9) + 0.2 * rng.normal(size=(4, 9)), rng.normal(size=(13, 9))
    upper[:, 4:] = lower[0, 4:] = 0.0
    lower[0, 4] = share * np.linalg.norm(lower[0, :4])
    return upper @ Q, lower @ Q, Q


class TestNearlyDependentRows:
    """A direction that is a share s of its row is exact to 1e-16/s only."""

    @pytest.mark.parametrize("share", [1e-10, 2e-9, 1e-8, 1e-7, 1e-6, 1e-4])
    @given(seed=SEEDS)
    def test_no_rounding_becomes_a_direction(self, seed, share):
        upper, lower, Q = nearly_dependent(np.random.default_rng(seed), share)
        rank, P = of_two_tasks(upper, lower)
        assert rank == 9
        exact = np.eye(15) - Q[:4].T @ Q[:4] - 0.6 * Q[4:].T @ Q[4:]
        np.testing.assert_allclose(P, exact, rtol=0, atol=1e-10)

    @pytest.mark.parametrize("share", [1e-10, 2e-9, 1e-7, 1e-5, 1e-2])
    @given(seed=SEEDS)
    def test_a_small_share_counts_where_no_other_row_has_more(self, seed, share):
        upper, lower, Q = nearly_dependent(np.random.default_rng(seed), share)
        rank, P = of_two_tasks(upper, np.vstack([lower[0], upper[0], -3.0 * lower[0]]))
        assert rank == (5 if share > 1e-9 else 4)
        exact = np.eye(15) - Q[:4].T @ Q[:4] - 0.6 * Q[4:rank].T @ Q[4:rank]
        np.testing.assert_allclose(P, exact, rtol=0, atol=1e-14 / share)

    @pytest.mark.parametrize("share", [2e-9, 1e-8, 1e-7, 1e-6])
    @given(seed=SEEDS)
    def test_the_order_of_rows_within_a_task_does_not_matter(self, seed, share):
        rng = np.random.default_rng(seed)
        upper, lower, _ = nearly_dependent(rng, share)
        rank, P = of_two_tasks(upper, lower)
        found, shuffled = of_two_tasks(rng.permutation(upper), rng.permutation(lower))
        assert found == rank
        np.testing.assert_allclose(shuffled, P, rtol=0, atol=1e-9)


class TestSums:
    """Of inputs of all kinds (section 8)."""

    def test_torques_of_a_lower_task_do_not_accelerate_a_strict_one(self):
        rng = np.random.default_rng(3)
        n = 6
        root = rng.normal(size=(n, n))
        inverse = np.linalg.inv(root @ root.T + np.eye(n))
        J = [rng.normal(size=(2, n)), rng.normal(size=(3, n))]
        torques = rng.normal(size=(2, n))
        tau = projected_sum(torques, [each @ inverse for each in J], [[0, 0], [1, 0]])
        np.testing.assert_allclose(J[0] @ inverse @ (tau - torques[0]), 0, atol=1e-12)
        assert np.abs(J[1] @ inverse @ (tau - torques[1])).max() > 1e-2

    def test_names_what_does_not_fit(self):
        with pytest.raises(BadProblemError, match=r"2.*3.*2 Jacobians"):
            projected_sum(np.ones((2, 3)), [np.eye(3)], np.zeros((2, 2)))
        with pytest.raises(BadProblemError):
            projected_sum([[np.nan]], [[[1.0]]], [[0]])


class TestSmoothed:
    """The continuous projector."""

    @given(SEEDS)
    def test_is_the_same_where_every_level_is_well_conditioned(self, seed):
        rng = np.random.default_rng(seed)
        J, alpha = rng.normal(size=(5, 9)), rng.choice([0.3, 0.6, 1], size=5)
        narrow = 1e-3 * np.linalg.svd(J)[1].min()
        smooth = generalized_projector(alpha, J, smoothing=narrow)
        np.testing.assert_allclose(smooth, generalized_projector(alpha, J), atol=1e-9)

    @given(SEEDS)
    def test_does_not_jump_where_the_rank_changes(self, seed):
        rng = np.random.default_rng(seed)
        J, alpha = rng.normal(size=(4, 6)), np.array([1, 1, 0.7, 0.4])
        end = J.copy()
        end[1], end[2] = J[0], 2 * J[0] - J[1]
        for smoothing, bar in ((0.5, 0.05), (0.0, 0.2)):
            near = generalized_projector(alpha, J + (1 - 1e-5) * (end - J), smoothing=smoothing)
            there = generalized_projector(alpha, J + 1.0 * (end - J), smoothing=smoothing)
            jump = np.linalg.norm(near - there, 2)
            assert (jump < bar) if smoothing else (jump > bar)

    @given(SEEDS, st.sampled_from([0.02, 0.5]))
    def test_a_strict_row_feels_no_more_than_a_quarter_of_the_width(self, seed, smoothing):
        """max t·(1 − 3t² + 2t³) = 0.2597 of it, at t = 0.42; nothing where σ ≥ s₀."""
        alpha, J = hard_case(seed)
        J = np.clip(J, -9, 9)
        alpha[0] = 1.0
        P = generalized_projector(alpha, J, smoothing=smoothing)
        strict = J[alpha == 1.0]
        assert np.linalg.norm(strict @ P, 2) <= 0.26 * smoothing + 1e-9
        wide = np.eye(J.shape[1])[: len(J) // 2 + 1]
        P = generalized_projector(np.ones(len(wide)), wide, smoothing=smoothing)
        assert np.abs(wide @ P).max() < 1e-12

    @given(SEEDS)
    def test_does_not_jump_where_priorities_meet_or_change_their_order(self, seed):
        """Rows in conflict, which the width fades: one leaves the level of the others."""
        rng = np.random.default_rng(seed)
        J = 0.3 * rng.normal(size=(6, 7))
        J[3:5] = J[:2] + 0.02 * rng.normal(size=(2, 7))
        together = rng.choice([0.3, 1.0], size=6)
        there = generalized_projector(together, J, smoothing=0.05)
        for row in range(6):
            for step in (-1e-9, 1e-9):
                apart = together.copy()
                apart[row] = min(apart[row] + step, 1.0)
                near = generalized_projector(apart, J, smoothing=0.05)
                assert np.linalg.norm(near - there, 2) < 1e-7

    @given(SEEDS)
    def test_an_identity_leaves_nothing_in_whatever_order(self, seed):
        rng = np.random.default_rng(seed)
        near = rng.normal(size=(1, 4)) + 1e-3 * rng.normal(size=(3, 4))
        J = np.vstack([near, np.eye(4)])
        alpha = np.repeat(rng.choice([0.4, 0.7, 1], size=2), [3, 4])
        P = generalized_projector(alpha, J, smoothing=0.9)
        assert np.linalg.norm(P, 2) <= 1.0 - alpha[-1] + 1e-9


def damped_null_space(alpha: float, J: np.ndarray) -> np.ndarray:
    """N′ = I − α J⁺J (5): two levels only, and one priority for a whole task."""
    return np.eye(J.shape[1]) - alpha * np.linalg.pinv(J, rcond=1e-9) @ J


def activated_null_space(theta: list[float], J: np.ndarray) -> np.ndarray:
    """N″ = I − V Θ Vᵀ (6): activations of the right singular vectors, not of the rows."""
    V = np.linalg.svd(J)[2].T
    return np.eye(J.shape[1]) - V * theta @ V.T


def summed_null_space(alpha: list[float], J: np.ndarray) -> np.ndarray:
    """N‴ = I − Σ_j α_j J_jᵀJ_j / |J_j|² (8): leaks where rows are not orthogonal, as (9) says."""
    unit = J / np.linalg.norm(J, axis=1)[:, None]
    return np.eye(J.shape[1]) - unit.T * alpha @ unit


class TestOthers:
    """(5), (6) and (8), all of other authors."""

    def test_5_and_6_are_null_space_projectors_at_their_ends(self):
        J = np.random.default_rng(2).normal(size=(2, 5))
        N = null_space(J)
        np.testing.assert_allclose(damped_null_space(1, J), N, atol=1e-12)
        np.testing.assert_allclose(damped_null_space(0, J), np.eye(5), atol=1e-12)
        np.testing.assert_allclose(activated_null_space([1, 1, 0, 0, 0], J), N, atol=1e-12)
        np.testing.assert_allclose(J @ damped_null_space(0.3, J), 0.7 * J, atol=1e-12)

    def test_8_leaks_into_a_strict_task_and_the_generalized_one_does_not(self):
        J = np.array([[1.0, 0, 0], [1, 1, 0]])
        alpha = [1, 0.5]
        assert np.abs(J[0] @ summed_null_space(alpha, J)).max() > 0.2
        assert np.abs(J[0] @ generalized_projector(alpha, J)).max() < 1e-15

    def test_8_is_right_where_rows_are_orthogonal(self):
        J, alpha = np.diag([1.0, 2, 3])[:2], [1, 0.4]
        P = generalized_projector(alpha, J)
        np.testing.assert_allclose(summed_null_space(alpha, J), P, atol=1e-15)


@pytest.mark.parametrize(
    ("alpha", "J", "smoothing"),
    [
        ([1.0, 1.5], np.eye(2), 0.0),
        ([-0.1, 1], np.eye(2), 0.0),
        ([np.nan, 1], np.eye(2), 0.0),
        ([1, 1], [[0, 0], [0, np.inf]], 0.0),
        ([1, 1], np.eye(2), -1.0),
    ],
)
def test_refuses_what_is_wrong(alpha, J, smoothing):
    with pytest.raises(BadProblemError, match="bad_input"):
        generalized_projector(alpha, J, smoothing=smoothing)
