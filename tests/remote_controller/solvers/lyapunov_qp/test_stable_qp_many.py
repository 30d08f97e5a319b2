"""The general problem against solvers that know nothing of ours, in thousands."""

from __future__ import annotations

import numpy as np
import pytest
from stable_problems import (
    M,
    N,
    Problem,
    by_quadprog,
    degenerate,
    generic,
    kkt_residual,
    most_descent,
)

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import FREE, QP, StableQp

SOLVER = {gamma: StableQp(N, M, gamma=gamma) for gamma in (0.0, 0.1, 0.5, 0.9, 0.99)}


def fault(problem: Problem) -> str:
    """What is wrong with our answer, "" if nothing."""
    solver = SOLVER[problem.gamma]
    if solver.solve(*problem.arguments) != status.OK:
        return status.NAMES[solver.status]
    rate = float(problem.gradient @ solver.u)
    promised = -solver.rho * problem.psi
    violation = max(-solver.margin, abs(rate - promised) / problem.top)
    if not violation <= 1e-9:
        return f"violation {violation}"
    if not solver.kkt_residual <= 1e-8:
        return f"own residual {solver.kkt_residual}"
    reference = by_quadprog(problem, promised)
    if reference is not None and np.abs(reference - solver.u).max() <= 1e-6:
        return ""
    residual = kkt_residual(problem, solver.u, promised)
    return "" if residual <= 1e-8 else f"residual {residual}"


def faults_of_generic(seed: int, count: int) -> list[str]:
    found = []
    for problem in generic(seed, count):
        wrong = fault(problem)
        rho = SOLVER[problem.gamma].rho
        found += [wrong] * bool(wrong) + [f"ρ {rho}"] * (not wrong and rho < 1 - 1e-8)
    return found


def faults_of_degenerate(seed: int, count: int) -> list[str]:
    found = []
    for kind, problem in degenerate(seed, count):
        wrong = fault(problem)
        best = min(1.0, most_descent(problem) / problem.psi)
        if not wrong and not -1e-8 <= best - SOLVER[problem.gamma].rho <= 1e-6:
            wrong = f"ρ {SOLVER[problem.gamma].rho} of {best}"
        found += [f"{kind}: {wrong}"] * bool(wrong)
    return found


def test_a_few_hundred_random_problems() -> None:
    assert faults_of_generic(seed=1, count=300) == []


def test_a_few_hundred_degenerate_problems() -> None:
    assert faults_of_degenerate(seed=2, count=150) == []


@pytest.mark.long
def test_five_thousand_random_problems() -> None:
    assert faults_of_generic(seed=3, count=5000) == []


@pytest.mark.long
def test_three_thousand_degenerate_problems() -> None:
    assert faults_of_degenerate(seed=4, count=3000) == []


def test_both_judges_see_a_wrong_answer() -> None:
    wrong = {
        "scaled": lambda u: u * 1.001,
        "another joint": lambda u: u + 1e-4 * np.eye(N)[0],
        "still": lambda u: u * 0.0,
    }
    for problem in generic(seed=5, count=20):
        solver = SOLVER[problem.gamma]
        solver.solve(*problem.arguments)
        reference = by_quadprog(problem, -problem.psi)
        assert reference is not None
        for spoil in wrong.values():
            spoilt = spoil(solver.u)
            assert np.abs(reference - spoilt).max() > 1e-6
            assert kkt_residual(problem, spoilt, -problem.psi) > 1e-8


def test_cheap_and_general_way_agree() -> None:
    """A row that never matters forces nothing; an equation of zeros forces the QP."""
    general = StableQp(N, M, 1, gamma=0.5)
    compared = 0
    for problem in generic(seed=6, count=150):
        cheap = SOLVER[0.5]
        cheap.solve(*problem.arguments)
        if cheap.path == QP:
            continue
        general.solve(*problem.arguments, np.zeros((1, N)), np.zeros(1))
        assert general.path == QP
        assert general.rho == cheap.rho == 1.0
        np.testing.assert_allclose(general.u, cheap.u, atol=1e-10)
        compared += 1
        assert cheap.path >= FREE
    assert compared > 20
