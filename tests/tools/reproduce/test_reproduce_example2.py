"""Example 2: the answers beside what is found without the paper's formula."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hoap3.tools.reproduce.papers.qp12 import example2


@pytest.fixture(scope="module")
def found():
    return example2.solve()


@pytest.fixture(scope="module")
def rows(found):
    return example2.rows(found)


def test_every_row_passes(rows):
    assert [row.item for row in rows if row.passed is not True] == []
    assert len(rows) == len({row.item for row in rows})


def test_answers_of_another_p_fail(found):
    """Each p with the next one's answer: only those two that share an answer pass."""
    powers = list(found.u)
    swapped = {p: found.u[other] for p, other in zip(powers, powers[1:] + powers[:1], strict=True)}
    short = replace(found, u={p: swapped[p] for p in powers})
    norms = [row for row in example2.rows(short) if "the least there is" in row.item]
    assert [row.passed for row in norms] == [True, *[False] * 6]


@pytest.mark.parametrize("p", [1.2, 1.5, 2.0, 4.0])
def test_the_descent_ends_where_hoelders_inequality_does(p):
    a, q = np.array([2.0, -1.0, 0.5, 0.0, 0.3]), p / (p - 1.0)
    bound = 0.7 / float((np.abs(a) ** q).sum() ** (1.0 / q))
    assert example2.least(a, 0.7, p) == pytest.approx(bound, rel=1e-8)
    assert example2.least(a, 0.7, p) >= bound * (1.0 - 1e-12)


@pytest.mark.parametrize("p", example2.POWERS)
def test_no_random_input_that_does_the_same_is_shorter(found, p):
    a, random = found.gradient, np.random.default_rng(2)
    directions = random.normal(size=(2000, a.size)) * random.uniform(size=(2000, a.size)) ** 4
    inputs = found.u[p] + directions - np.outer(directions @ a, a) / (a @ a)
    for step in (1e-6, 1e-3, 1.0):
        tried = found.u[p] + step * (inputs - found.u[p])
        np.testing.assert_allclose(tried @ a, -found.decrease, rtol=1e-6)
        shortest = min(example2.norm(each, p) for each in tried[:200])
        assert shortest >= example2.norm(found.u[p], p) * (1.0 - 1e-12)


def test_a_norm_is_what_it_says():
    u = np.array([3.0, 0.0, -4.0])
    assert example2.norm(u, 2.0) == pytest.approx(5.0)
    assert example2.norm(u, 1.0) == pytest.approx(7.0)
    assert example2.norm(u, math.inf) == 4.0
    assert example2.norm(u, 0.5) == pytest.approx((math.sqrt(3.0) + 2.0) ** 2)
    assert example2.norm(0.0 * u, 1.5) == 0.0


def test_the_picture_has_every_p_and_every_joint_by_name(found):
    (panel,) = example2.draw(found).panels
    assert len(panel.curves) == len(example2.POWERS)
    assert len(panel.curves[0].x) == 1
    assert len(panel.curves[-1].x) == 21
    assert panel.categories[:2] == ("r_ankle_pitch", "r_knee")
