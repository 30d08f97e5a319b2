"""HOAP-3 in MuJoCo on one held foot and on its own two: the bars, and what breaks them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hoap3.remote_controller.config import read_config
from hoap3.remote_controller.controllers.servo_rate import loop_rate
from hoap3.tools.reproduce.papers.qp12 import own_feet
from hoap3.tools.reproduce.papers.qp12.experiments import law_settings
from hoap3.tools.reproduce.papers.qp12.own_feet import (
    FALLEN_MM,
    LAWS,
    NEAR_MM,
    NOISE_RAD,
    RISE_MM,
    STANDING_MM,
    TILT_DEG,
    stand,
)
from hoap3.tools.reproduce.papers.qp12.reference import EVEN, PINV, SPARSE


def kept() -> dict:
    content, _ = read_config("stable_qp_standing")
    return content


def test_on_one_foot_it_gets_nearer_without_a_step_back():
    stood = stand("hoap3_one_foot", law_settings(SPARSE), 1.5)
    assert np.linalg.norm(stood.error[0]) == pytest.approx(0.0187, abs=2e-4)  # the paper's
    assert stood.end_mm < 6.0
    assert stood.rise_mm < RISE_MM
    assert stood.certified[0] == stood.certified[1] > 1000
    assert stood.saturated == 0


def test_standing_it_keeps_both_soles_on_the_floor():
    stood = stand("hoap3_standing", kept(), 1.5)
    assert stood.end_mm < 12.0
    assert stood.lifted == 0
    assert stood.tilt_deg < TILT_DEG
    assert stood.certified[0] == stood.certified[1] > 1000


def test_a_law_that_is_faster_than_the_servos_certifies_nothing():
    stood = stand("hoap3_one_foot", law_settings(EVEN, "C"), 0.1, kv=6.0)
    assert stood.certified[0] == 0
    assert stood.certified[1] == 100
    blind = law_settings(EVEN, "C")
    blind["parameters"]["kinematics_from"] = "reference"  # then it is no loop around them
    assert stand("hoap3_one_foot", blind, 0.1, kv=6.0).certified == (100, 100)


def test_the_rate_is_that_of_the_law_around_its_target():
    """The largest eigenvalue of ∂u/∂q by differences, e being along the axis that moves least."""
    rng = np.random.default_rng(5)
    J = rng.normal(size=(3, 7)) * np.array([[1.0], [0.6], [0.2]])
    U, sizes, _ = np.linalg.svd(J)
    u_max, beta = 0.6, 46.0
    c = 2.0 / np.pi * u_max * beta

    def u(dq: np.ndarray) -> np.ndarray:
        e = 1e-4 * U[:, 2] + J @ dq
        gradient = J.T @ e
        return -c * np.linalg.norm(e) / np.linalg.norm(gradient) * gradient

    step = 1e-9 * np.eye(7)
    B = -np.array([(u(each) - u(-each)) / 2e-9 for each in step]).T
    fastest = np.abs(np.linalg.eigvals(B)).max()
    bound = loop_rate("one", (u_max, beta), J)
    assert bound == pytest.approx(c * sizes[0] ** 2 / sizes[2])
    assert 0.8 * bound < fastest <= bound * (1.0 + 1e-6)
    assert loop_rate("one", (u_max, beta), J, pseudo_inverse=True) == pytest.approx(c * sizes[0])
    assert loop_rate("inverse_sqrt_n", (u_max, beta), J) == pytest.approx(bound / np.sqrt(7))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "kv", "scale", "stays"),
    [
        (PINV, 12.0, "C", True),  # 5.4 of 9.6 1/s
        (PINV, 6.0, "C", False),  # 5.4 of 4.8
        (EVEN, 12.0, "A", True),  # 6.9 of 9.6
        (EVEN, 6.0, "C", False),  # 31.5 of 4.8: it falls
        (EVEN, 12.0, "C", False),  # 31.5 of 9.6
    ],
)
def test_v_rises_where_the_loop_is_faster_than_the_servos(law, kv, scale, stays):
    """With a ramp, so that motors have the torque to begin; what stays rises by rounding only."""
    settings = law_settings(law, scale)
    settings["parameters"]["ramp_s"] = 1.0
    stood = stand("hoap3_one_foot", settings, 6.0, kv=kv)
    assert (stood.certified[0] > 0) == stays
    assert stood.rise_mm < 0.01 if stays else stood.rise_mm > 0.1
    assert (stood.end_mm > FALLEN_MM) == ((law, kv, scale) == (EVEN, 6.0, "C"))


def test_rows_fail_where_a_bar_is_broken():
    def a_run(**told: object) -> own_feet.Stood:
        figures = {
            "largest_tilt_deg": {"r_sole": 0.1},
            "periods_off_the_ground": {"r_sole": 0},
            "com_world_m": list(own_feet.TARGET_M),
            "servo_rate_limit_1_s": 9.5,
        }
        return own_feet.Stood(np.zeros((5, 3)), {**figures, **told}, (0, 5), 0)

    good = a_run()
    far = replace(good, error=np.full((5, 3), 1e-3))
    fallen = a_run(largest_tilt_deg={"r_sole": 40.0}, periods_off_the_ground={"r_sole": 3})
    beyond = replace(good, error=np.full((5, 3), 0.2), certified=(0, 5))
    name = "stable_qp, both soles kept"
    made = own_feet.rows({(PINV, 0.0): good}, {name: good, "QP12": far}, beyond)
    assert all(row.passed is not False for row in made)
    assert [row.passed for row in made].count(None) == 3
    broken = own_feet.rows({(PINV, 0.0): far}, {name: fallen}, replace(beyond, certified=(1, 5)))
    assert [row.passed for row in broken].count(False) == 4
    for no_fall in (replace(beyond, error=good.error), replace(beyond, certified=(0, 0))):
        made = own_feet.rows({(PINV, 0.0): good}, {name: good}, no_fall)
        assert [row.passed for row in made].count(False) == 1
    assert own_feet.draw({(law, 0.0): good for law in LAWS}, {name: good}).panels


@pytest.mark.long
@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_one_foot_ends_at_the_target_for_every_law_and_seed(law, seed):
    """The paper's 18.7 mm, 20 s, sensors with noise."""
    stood = stand("hoap3_one_foot", law_settings(law), seed=seed, noise_rad=NOISE_RAD)
    assert stood.end_mm < NEAR_MM
    assert stood.rise_mm < RISE_MM


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_standing_it_never_falls(seed):
    stood = stand("hoap3_standing", kept(), seed=seed, noise_rad=NOISE_RAD)
    assert stood.end_mm < STANDING_MM
    assert stood.lifted == 0
    assert stood.tilt_deg < TILT_DEG
