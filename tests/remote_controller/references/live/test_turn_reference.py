"""Orientations of live targets against matrix exponentials and logarithms of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.references.live import live_kernels, turn_kernels
from hoap3.remote_controller.references.live import live_reference as curves
from hoap3.remote_controller.references.live import turn_reference as reference

PLACE = 2  # columns before


def apart(found: Rotation, expected: Rotation) -> float:
    """Angle between two orientations [rad]."""
    return float((found * expected.inv()).magnitude())


def vectors(rng: np.random.Generator, most: float) -> np.ndarray:
    """r, ṙ and r̈, (3, 3), of any size up to a most."""
    rows = rng.normal(size=(3, 3))
    rows[0] *= 10.0 ** rng.uniform(-9, 0) * most / np.linalg.norm(rows[0])
    return rows


@pytest.mark.parametrize("problems", [300, pytest.param(5000, marks=pytest.mark.long)])
def test_vectors_and_orientations_are_those_of_matrices(problems):
    rng = np.random.default_rng(0)
    for _ in range(problems):
        anchor, vector = Rotation.random(rng=rng), vectors(rng, 6.0)
        wide, state, back = np.zeros((3, 5)), np.zeros((3, 6)), np.zeros((3, 5))
        wide[:, PLACE:] = vector
        turn_kernels.from_vector(anchor.as_quat(), wide, PLACE, state)
        Q, omega, alpha = reference.from_vector(anchor.as_quat(), vector)
        assert apart(Rotation.from_quat(state[0, PLACE:]), Q) < 1e-12
        np.testing.assert_allclose(state[1, PLACE:5], omega, rtol=0, atol=1e-11)
        np.testing.assert_allclose(state[2, PLACE:5], alpha, rtol=0, atol=1e-11)
        assert not state[:, :PLACE].any()
        assert not state[1:, 5].any()
        turn_kernels.to_vector(anchor.as_quat(), state, PLACE, back)
        if np.linalg.norm(vector[0]) < 3.1:
            np.testing.assert_allclose(back[:, PLACE:], vector, rtol=0, atol=1e-11)
            expected = reference.to_vector(anchor.as_quat(), Q.as_quat(), omega, alpha)
            np.testing.assert_allclose(back[:, PLACE:], expected, rtol=0, atol=1e-9)


def test_the_shorter_way_round_is_found_from_any_two_orientations():
    rng = np.random.default_rng(1)
    for _ in range(300):
        anchor, place = Rotation.random(2, rng=rng)
        state, found = np.zeros((3, 4)), np.zeros((3, 3))
        state[0] = rng.choice([-1.0, 1.0]) * place.as_quat()
        turn_kernels.to_vector(anchor.as_quat(), state, 0, found)
        np.testing.assert_allclose(found[0], (place * anchor.inv()).as_rotvec(), atol=1e-12)
        assert not found[1:].any()


@pytest.mark.parametrize("problems", [300, pytest.param(5000, marks=pytest.mark.long)])
def test_a_curve_of_quaternions_turns_as_its_matrices_do(problems):
    rng = np.random.default_rng(2)
    for _ in range(problems):
        curve = rng.normal(size=(4, 4))
        curve[0] *= rng.uniform(0.5, 1.0) / np.linalg.norm(curve[0])
        wide = np.zeros((4, 6))
        wide[:, PLACE:] = curve
        turn_kernels.normalise(wide, PLACE)
        Q, rates = reference.normalised(curve)
        assert apart(Rotation.from_quat(wide[0, PLACE:]), Q) < 1e-13
        assert abs(np.linalg.norm(wide[0]) - 1.0) < 1e-14
        scale = 1.0 + np.abs(rates).max()
        np.testing.assert_allclose(wide[1:, PLACE:5], rates, rtol=0, atol=1e-12 * scale)


def test_the_extremes_of_a_turning_curve_are_the_greatest_of_many_looks():
    rng = np.random.default_rng(3)
    for _ in range(10):
        points = Rotation.from_rotvec(rng.normal(scale=0.3, size=(4, 3))).as_quat()
        nodes, step = np.hstack([points, *rng.normal(scale=0.3, size=(2, 4, 4))]), 0.2
        found = np.zeros((3, 4))
        live_kernels.extremes(0.0, step, nodes, 4, 0, np.zeros((4, 4)), found)
        looks = step / live_kernels.LOOKS * np.arange(3 * live_kernels.LOOKS + 1)
        rates = [reference.normalised(curves.curve_at(t, step, nodes, 4))[1] for t in looks]
        np.testing.assert_allclose(found[:, :3], np.abs(rates).max(0), rtol=1e-6)
