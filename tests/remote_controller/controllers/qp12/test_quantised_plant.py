"""Coarse encoders and lagging servos: what reaches the target, and what stalls.

One encoder count is 8.35e-5 rad, and 1 count a tick 0.08 rad/s: more than most commands.
"""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, TARGET, Run, run
from free_flyer import FreeFlyer

COUNTS = (("encoder", "counts"),)
LAG = (("servo", "lag"), ("time_constant_ms", 20.0))
TICKS = 6_000
CASE_A = {"psi_scale": "inverse_sqrt_n"}
LAWS = [{"gamma": 0.0}, {"gamma": 0.5}, {"gamma": 0.99, "adaptive_gamma": True}]
floating = FreeFlyer(HOAP3)
each_law = pytest.mark.parametrize("law", LAWS, ids=str)
each_scale = pytest.mark.parametrize("scale", ["inverse_sqrt_n", "one"])


def errors(positions: np.ndarray) -> np.ndarray:
    """|e| of each row [m], by other kinematics than the controller's."""
    return np.array([np.linalg.norm(floating.com("r_sole", q)[0] - TARGET) for q in positions])


def final(motion: Run) -> np.ndarray:
    """|e| of the last tick, of what is measured and of the reference [m]."""
    return errors(np.array([motion.q[-1], motion.reference[-1]]))


@each_law
@each_scale
def test_a_reference_in_double_ends_where_the_ideal_one_does(law, scale):
    ideal = run("qp12", TICKS, psi_scale=scale, **law)
    coarse = run("qp12", TICKS, plant=COUNTS, psi_scale=scale, kinematics_from="reference", **law)
    np.testing.assert_array_equal(coarse.reference, ideal.reference)
    assert np.abs(final(coarse) - final(ideal)).max() <= 0.03e-3


@each_law
@each_scale
def test_measured_counts_end_within_what_the_grid_of_counts_allows(law, scale):
    """The target is between grid points: a sparse law toggles one joint and leaves the rest be.

    It stops caring for z where its slope is below that of one count of the ankle,
    |e_z|·max|J_z| ≤ count·max|J|·max|J|, so |e| ends below count·max|J|·(1 + max|J|/max|J_z|).
    """
    ideal = run("qp12", TICKS, psi_scale=scale, **law)
    coarse = run("qp12", TICKS, plant=COUNTS, psi_scale=scale, **law)
    jacobian = floating.com("r_sole", coarse.q[-1])[1]
    largest, upright = np.abs(jacobian).max(), np.abs(jacobian[2]).max()
    count = 1 / np.abs(HOAP3.counts_per_rad).max()
    grid = count * largest * (1 + largest / upright)
    assert grid < 0.15e-3
    assert (final(coarse) <= final(ideal) + grid).all()


@each_law
def test_integrating_what_is_measured_stalls(law):
    stalled = run("qp12", TICKS, plant=COUNTS, integrate_from="measured", **CASE_A, **law)
    assert final(stalled).min() >= 5e-3
    still = slice(TICKS // 2, None)
    np.testing.assert_array_equal(np.ptp(stalled.q[still], axis=0), 0.0)


def test_integrating_what_is_measured_is_the_same_without_an_encoder():
    measured = run("qp12", 500, integrate_from="measured", **CASE_A)
    np.testing.assert_array_equal(measured.reference, run("qp12", 500, **CASE_A).reference)


@each_law
@each_scale
@pytest.mark.parametrize("source", ["reference", "measured"])
def test_a_lagging_plant_converges_and_v_of_the_reference_never_rises(law, scale, source):
    motion = run("qp12", TICKS, plant=LAG, psi_scale=scale, kinematics_from=source, **law)
    assert (np.diff(errors(motion.reference[::50])) <= 0.0).all()
    if source == "reference":
        assert (np.diff(motion.v) <= 0.0).all()
    ideal = run("qp12", TICKS, psi_scale=scale, **law)
    five_time_constants_ago = errors(ideal.q[-101:-100])
    assert (final(motion) <= five_time_constants_ago).all()
