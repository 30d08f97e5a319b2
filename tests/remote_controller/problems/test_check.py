"""The checker of problems: optima of independent solvers pass, and what is off by 1e-7 does not."""

from __future__ import annotations

from dataclasses import replace

import daqp
import numpy as np
import osqp
import pytest
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from hoap3.remote_controller.problems.check import (
    check,
    check_problem,
    infeasibility,
    upper_bound,
)
from hoap3.remote_controller.problems.statement import (
    Cascade,
    Claim,
    ClosedForm,
    Level,
    MaximalRate,
    Program,
    Rows,
    Statement,
)

EXACT = 1e-10  # of what daqp finds at these sizes
SEEDS = range(40)


def random_rows(random, n, s, *, equations=0):
    """Rows that a random point keeps, so that there is a solution."""
    inside, A = random.normal(size=n), random.normal(size=(s, n))
    v = A @ inside
    lower, upper = v - random.random(s), v + random.random(s)
    lower[:equations] = upper[:equations] = v[:equations]
    return Rows.of(A, lower, upper, error=EXACT, A_error=1e-14)


def optimum_of(program):
    """The z of a program without absolute values, by daqp."""
    R, r, c, rows = program.R, program.r, program.c, program.rows
    sense = np.where(rows.lower == rows.upper, 5, 0).astype(np.int32)
    limits = rows.upper.copy(), rows.lower.copy()
    z, _, flag, _ = daqp.solve(R.T @ R, c - R.T @ r, rows.A.copy(), *limits, sense)
    assert flag == 1
    return np.asarray(z)


def optimum_with_absolute_values(program):
    """The z of any program, by OSQP in (z, t), |z| ≤ t."""
    R, r, rows, n = program.R, program.r, program.rows, len(program.c)
    eye, none = np.eye(n), np.zeros((len(rows.a), n))
    A = np.vstack([np.hstack([rows.A, none]), np.hstack([eye, -eye]), np.hstack([eye, eye])])
    far = np.full(n, np.inf)
    solver = osqp.OSQP()
    solver.setup(
        csc_matrix(np.block([[R.T @ R, 0.0 * eye], [0.0 * eye, 0.0 * eye]])),
        np.concatenate([program.c - R.T @ r, program.l1]),
        csc_matrix(A),
        np.concatenate([rows.lower, -far, np.zeros(n)]),
        np.concatenate([rows.upper, np.zeros(n), far]),
        eps_abs=1e-11,
        eps_rel=1e-11,
        max_iter=200_000,
        polishing=True,
        verbose=False,
    )
    return solver.solve().x[:n]


def random_program(random, *, l1=0.0, equations=0):
    n, s = int(random.integers(2, 7)), int(random.integers(1, 6))
    equations = min(equations, s, n - 1)
    rows = random_rows(random, n, s, equations=equations)
    R, r = random.normal(size=(n + 2, n)), random.normal(size=n + 2)
    c, eye = random.normal(size=n), np.eye(n)
    return Program(R, r, c, np.full(n, l1), rows, eye, np.zeros(n), np.full(n, 1e-9))


def holds(problem, answer, error=0.0):
    found = check_problem(problem, answer, np.full(len(answer), error))
    return all(each.holds for each in found)


@pytest.mark.parametrize("equations", [0, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_an_optimum_passes_and_every_other_answer_does_not(seed, equations):
    random = np.random.default_rng(seed)
    program = random_program(random, equations=equations)
    z = optimum_of(program)

    assert holds(program, z)
    for k in range(len(z)):
        for step in (1e-6, -1e-6):
            off = z.copy()
            off[k] += step
            assert not holds(program, off)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_optimum_of_an_absolute_value_stands_still(seed):
    random = np.random.default_rng(seed)
    program = random_program(random, l1=float(random.uniform(0.5, 5.0)))
    z, near = optimum_with_absolute_values(program), 1e-8  # OSQP's
    rows = replace(program.rows, error=np.full(len(program.rows.a), near))
    program = replace(program, rows=rows, error=np.full(len(z), near))

    assert holds(program, z)
    for k in range(len(z)):
        off = z.copy()
        off[k] += 1e-5
        assert not holds(program, off)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_answer_that_is_a_part_of_the_variables_is_completed(seed):
    """answer = E z + e with fewer numbers than variables: a projection of the optimum."""
    random = np.random.default_rng(seed)
    program = random_program(random)
    n = len(program.c)
    wide = replace(
        program,
        R=np.vstack([np.hstack([program.R, np.zeros((n + 2, 2))]), 0.7 * np.eye(n + 2)]),
        r=np.concatenate([program.r, random.normal(size=n + 2)]),
        c=np.append(program.c, random.normal(size=2)),
        l1=np.zeros(n + 2),
        rows=Rows.of(np.zeros((0, n + 2)), 0.0, 0.0),
    )
    H = wide.R.T @ wide.R
    z = np.linalg.solve(H, wide.R.T @ wide.r - wide.c)
    E, e = random.normal(size=(3, n + 2)), random.normal(size=3)
    part = replace(wide, E=E, e=e, error=np.full(3, 1e-9))

    assert holds(part, E @ z + e)
    assert not holds(part, E @ z + e + np.array([0.0, 1e-6, 0.0]))


def test_a_variable_that_the_answer_does_not_show_hides_nothing():
    """min ½u² + ½s² with u + s ≥ 2, of which the answer is u: 1, not 0.5 with s = 1.5."""
    rows = Rows.of(np.array([[1.0, 1.0]]), 2.0, np.inf)
    E, none, eye = np.array([[1.0, 0.0]]), np.zeros(2), np.eye(2)
    program = Program(eye, none, none, none, rows, E, np.zeros(1), np.full(1, 1e-9))

    assert holds(replace(program, z=np.array([1.0, 1.0])), np.array([1.0]))
    assert not holds(replace(program, z=np.array([0.5, 1.5])), np.array([0.5]))


def test_a_row_that_is_optional_may_be_broken_but_may_hold():
    rows = Rows.of(np.array([[1.0, 0.0]]), -np.inf, 1.0, optional=True)
    eye, zero = np.eye(2), np.zeros(2)
    program = Program(eye, np.array([2.0, 0.0]), zero, zero, rows, eye, zero, np.full(2, 1e-12))

    assert holds(program, np.array([1.0, 0.0]))  # at the row
    assert holds(program, np.array([2.0, 0.0]))  # beyond it, at the optimum without
    assert not holds(program, np.array([1.5, 0.0]))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_largest_rate_is_that_of_a_linear_program(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 6))
    rows = Rows.stacked([random_rows(random, n, 3), Rows.of(np.eye(n), -2.0, 2.0, error=EXACT)])
    g = random.normal(size=n)
    A, b = np.vstack([rows.A, -rows.A]), np.concatenate([rows.upper, -rows.lower])
    found = linprog(-g, A, b, bounds=(None, None))
    assert found.success
    best = -found.fun
    bound = upper_bound(g, rows)
    assert bound.value == pytest.approx(best, abs=1e-8)

    eye, zero = np.eye(n), np.zeros(n)
    then = Program(eye, found.x, zero, zero, rows, eye, zero, np.full(n, 1e-7))
    problem = MaximalRate(g, np.inf, rows, (), 1e-9, then)
    assert holds(problem, found.x)
    slower = found.x - 1e-5 * g
    assert not holds(replace(problem, then=replace(then, r=slower)), slower)


def random_cascade(random):
    """Three levels in conflict, within rows, and its answer by daqp, level by level.

    Above them stand no equations, one, or two that say the same.
    """
    n, w, unit = 7, 0.01, random.normal(size=7)
    unit, count, side = unit / np.linalg.norm(unit), random.integers(3), random.normal()
    equations = Rows.of(np.tile(unit, (count, 1)), *np.full((2, count), 0.1 * side))
    levels = tuple(
        Level(random.normal(size=(m, n)), 5.0 * random.normal(size=m)) for m in (2, 3, 7)
    )
    A = np.vstack([np.eye(n), random.normal(size=(3, n))])
    rows = Rows.of(A, -1.0 - random.random(len(A)), 1.0 + random.random(len(A)), error=EXACT)
    x, Z, steps, slack = np.zeros(n), np.eye(n), [], 0.0
    if count:
        x, Z = 0.1 * side * unit, np.linalg.svd(unit[None])[2][1:].T
    for J, b in levels:
        H = Z.T @ J.T @ J @ Z + w * np.eye(Z.shape[1])
        upper, lower = rows.upper + slack - A @ x, rows.lower - slack - A @ x
        sense = np.zeros(len(A), np.int32)
        f = -Z.T @ J.T @ (b - J @ x)
        z, _, flag, _ = daqp.solve(H, f, A @ Z, upper, lower, sense, primal_tol=1e-11)
        assert flag == 1
        steps.append(Z @ np.asarray(z))
        x, slack = x + steps[-1], 1e-8
        Z = Z @ np.linalg.svd(J @ Z)[2][len(J) :].T
    given = rows, equations, 1e-8, 1e-9, tuple(steps), np.full(n, 1e-8)
    return Cascade(levels, w, *given), x


@pytest.mark.parametrize("seed", SEEDS)
def test_the_answer_of_a_cascade_passes_and_every_other_does_not(seed):
    random = np.random.default_rng(seed)
    problem, x = random_cascade(random)

    assert holds(problem, x)
    for k in range(len(x)):
        assert not holds(problem, x + 1e-6 * np.eye(len(x))[k])


@pytest.mark.parametrize("seed", SEEDS)
def test_steps_that_are_no_optima_of_their_levels_prove_nothing(seed):
    random = np.random.default_rng(seed)
    problem, x = random_cascade(random)
    first, second, third = problem.steps
    by = 1e-6 * random.normal(size=len(x))

    assert not holds(replace(problem, steps=(first + by, second - by, third)), x)
    assert not holds(replace(problem, steps=(first, second + by, third - by)), x)
    assert not holds(replace(problem, steps=(first, second, third + by)), x + by)
    if len(problem.equations.a):
        other = replace(problem.equations, lower=problem.equations.lower + 1e-6)
        assert not holds(replace(problem, equations=other), x)


def test_rows_that_exclude_each_other_have_no_answer():
    A = np.array([[1.0, 1.0], [1.0, 1.0]])

    assert infeasibility(Rows.of(A, np.array([1.0, -np.inf]), np.array([np.inf, 0.0]))) == (
        pytest.approx(0.5)
    )
    assert infeasibility(Rows.of(A, -1.0, 1.0)) <= 0.0


def test_one_of_several_values_is_enough():
    problem = ClosedForm((np.array([1.0, 0.0]), np.array([0.0, 1.0])), np.full(2, 1e-9))

    assert holds(problem, np.array([0.0, 1.0]))
    assert not holds(problem, np.array([0.5, 0.5]))


@pytest.mark.parametrize(
    ("stated", "value", "relation", "holds"),
    [
        (1.0, 1.0, "equal", True),
        (1.0, 1.2, "equal", False),
        (1.0, 1.2, "at_most", True),
        (1.2, 1.0, "at_most", False),
        (1.0, 1.2, "at_least", False),
        (np.nan, 1.0, "equal", False),
        (np.nan, 1.0, "at_most", False),
        (1.0, np.nan, "at_least", False),
        (np.nan, np.nan, "equal", True),
        (np.inf, np.inf, "equal", True),
    ],
)
def test_a_number_is_compared_by_its_relation(stated, value, relation, holds):
    claim = Claim("number", stated, value, 0.1, relation)

    (found,) = check(Statement("", (), np.zeros(0), np.zeros(0), (claim,)))

    assert found.holds is holds


def test_the_first_problem_that_the_answer_solves_counts():
    wrong = ClosedForm((np.array([2.0]),), np.array([1e-9]))
    right = ClosedForm((np.array([1.0]),), np.array([1e-9]))
    one, exact = np.array([1.0]), np.zeros(1)

    assert all(f.holds for f in check(Statement("", (lambda: wrong, lambda: right), one, exact)))
    assert not all(f.holds for f in check(Statement("", (lambda: wrong,), one, exact)))


def test_a_row_without_a_limit_hides_no_broken_one():
    none = np.array([np.inf, 1e-9])  # as of an error that is relative to the limit
    rows = Rows.of(np.ones((2, 1)), np.array([-np.inf, -1.0]), np.array([np.inf, 1.0]), error=none)
    problem = Program.of(np.eye(1), np.array([5.0]), rows, 1e-9)

    found = check_problem(problem, np.array([5.0]), np.zeros(1))
    assert [each.name for each in found if not each.holds] == ["rows"]
