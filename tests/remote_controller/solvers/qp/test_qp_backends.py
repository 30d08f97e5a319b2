"""Every solver behind the one call: the same optimum, and multipliers that prove it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.qp_peers import installed
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.active_set import ActiveSet
from hoap3.remote_controller.solvers.qp.dense_qp import EQUATION, NO_BOUND, Program, daqp

MAKERS = {**installed(), "ours": ActiveSet}
NEAR = {"osqp": 1e-4, "proxqp": 1e-6, "piqp": 1e-6}
"""How near splitting and interior-point methods get; the others are exact."""


def random_program(seed: int) -> Program:
    """With bounds, one-sided rows, rows that are off, and an equation that leaves a solution."""
    rng = np.random.default_rng(seed)
    v, r = int(rng.integers(2, 9)), int(rng.integers(1, 7))
    root, A = rng.normal(size=(v, v)), rng.normal(size=(r, v))
    least, most = -rng.exponential(size=v + r), rng.exponential(size=v + r)
    least[rng.random(v + r) < 0.3], most[rng.random(v + r) < 0.3] = -NO_BOUND, NO_BOUND
    sense = np.zeros(v + r, np.int32)
    sense[v] = EQUATION
    inside = rng.normal(size=v)
    values = np.concatenate([inside, A @ inside])
    inside *= 0.5 * np.min(np.where(values > 0.0, most, -least) / np.abs(values))
    least[v] = most[v] = A[0] @ inside
    H = root @ root.T + 0.1 * np.eye(v)
    return Program(H, 3.0 * rng.normal(size=v), A, least, most, sense)


def wrong(program: Program, x: np.ndarray, multipliers: np.ndarray) -> float:
    """The largest deviation from the conditions of an optimum; the bounds' are what is left."""
    pull = np.r_[-(program.H @ x + program.f + program.A.T @ multipliers), multipliers]
    values = np.r_[x, program.A @ x]
    best = np.clip(values + pull, program.least, program.most)
    size = np.r_[np.ones(x.size), np.maximum(1.0, np.abs(program.A).max(axis=1))]
    return float((np.abs(values - best) / size).max())


@pytest.mark.parametrize("name", MAKERS)
def test_the_answer_and_its_multipliers_are_those_of_the_optimum(name: str) -> None:
    near = NEAR.get(name, 1e-9)
    held = 0
    for seed in range(100):
        program = random_program(seed)
        solved, x, multipliers = MAKERS[name](program)(1e-11)
        assert solved
        assert wrong(program, x, multipliers) <= near
        np.testing.assert_allclose(x, daqp(program)(1e-11)[1], atol=10 * near)
        held += int((multipliers[1:] < -near).any()) + int((multipliers[1:] > near).any())
    assert held > 50  # rows hold it back on either side


@pytest.mark.parametrize("name", [name for name in MAKERS if name != "osqp"])
def test_none_calls_rows_solved_that_contradict(name: str) -> None:
    program = random_program(0)
    program.A = np.vstack([program.A[:1], program.A[:1]])
    count = program.f.size + 2
    program.least, program.most = np.full(count, -NO_BOUND), np.full(count, NO_BOUND)
    program.least[-2], program.most[-1] = 1.0, -1.0
    program.sense = np.zeros(count, np.int32)
    solved, x, _ = MAKERS[name](program)(1e-9)
    assert not solved
    assert x.shape == program.f.shape


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("contradictory", status.INFEASIBLE),
        ("crossed", status.INFEASIBLE),
        ("indefinite", status.BAD_INPUT),
        ("not finite", status.BAD_INPUT),
    ],
)
def test_ours_says_why_it_has_no_answer(name: str, expected: int) -> None:
    program = random_program(3)
    v = program.f.size
    if name == "contradictory":
        program.A = np.vstack([program.A[:1], -program.A[:1]])
        program.least, program.most = np.full(v + 2, -np.inf), np.full(v + 2, np.inf)
        program.least[v:] = 1.0
    elif name == "crossed":
        program.least[0], program.most[0] = 1.0, 0.5
    elif name == "indefinite":
        program.H[0, 0] = -1.0
    else:
        program.A[0, 0] = np.nan
    assert ActiveSet(program).solve()[0] == expected


def test_ours_takes_equations_that_depend_on_each_other_and_rows_of_any_scale() -> None:
    program = random_program(5)
    plain = ActiveSet(program).solve()
    v, scale = program.f.size, 1e7
    program.A = np.vstack([program.A, scale * program.A[:1]])
    program.least = np.append(program.least, scale * program.least[v])
    program.most = np.append(program.most, scale * program.most[v])
    program.sense = np.append(program.sense, np.int32(EQUATION))
    found, x, multipliers = ActiveSet(program).solve()
    assert found == plain[0] == status.OK
    np.testing.assert_allclose(x, plain[1], rtol=1e-9, atol=1e-12)
    assert wrong(program, x, multipliers) <= 1e-9
