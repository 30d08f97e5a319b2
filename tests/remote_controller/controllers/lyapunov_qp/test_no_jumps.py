"""`stable_qp` where it cannot have what is asked for: it gives way without jumping to and fro."""

from __future__ import annotations

import numpy as np
import pytest
from stable_runs import run, settings

SPEED = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 1.0}}
RANGE = {"constraint": "joint_position"}
POLYGON = {"constraint": "support_polygon", "parameters": {"margin_m": 0.005}}
BEYOND = [0.1, 0.02, 0.285]  # m: in front of the sole


def com(**target):
    return {"task": "com", "parameters": {"frame": "r_sole", "target": target}}


def changes(found) -> np.ndarray:
    """Largest change of any joint's speed from tick to tick [rad/s]."""
    return np.abs(np.diff(found.speeds, axis=0)).max(axis=1)


MOVING = {
    "circle": com(
        kind="circle", center_m=[0, 0.02, 0.285], radius_m=0.05, period_s=8.0, approach_s=1.0
    ),
    "waypoints": com(
        kind="waypoints", points_m=[[0.06, 0.02, 0.285], [0.0, 0.02, 0.285]], times_s=[1.5, 3.0]
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("task", MOVING)
def test_behind_a_target_that_moves_outside_it_slides_along_the_edge(task):
    found = run(
        settings(
            task=MOVING[task],
            constraints=[SPEED, RANGE, POLYGON],
            objective={"kind": "qp12", "gamma": 0.0},
        ),
        4.0,
    )
    assert (found.setpoints["rho"] < 0.0).any()
    assert found.began["cannot_descend"] >= 1
    # a few where e is tiny and its direction turns; with the largest ρ thousands, of 2 rad/s
    assert (changes(found) > 0.5).sum() < 20
    assert found.setpoints["margin"].min() >= -1e-6


@pytest.mark.slow
def test_started_outside_a_polygon_it_comes_in_and_rests():
    deep = {"constraint": "support_polygon", "parameters": {"margin_m": 0.03}}
    found = run(settings(constraints=[SPEED, RANGE, deep]), 3.0)
    assert found.setpoints["margin"][0] < -0.02
    assert found.setpoints["margin"][-1] >= -1e-9
    assert changes(found).max() < 0.3
    assert np.abs(found.speeds[-100:]).max() < 1e-6
    assert "unsolved" not in found.began


def test_a_return_that_joints_are_too_slow_for_is_as_fast_as_half_of_what_they_can():
    slow = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.1}}
    lift = {
        "constraint": "half_space",
        "parameters": {
            "frame": "r_forearm",
            "reference": "pelvis",
            "normal": [0, 0, 1],
            "offset_m": 0.2,
            "return_speed_m_s": 10.0,
            "eta_per_s": 1000.0,
        },
    }
    found = run(settings(constraints=[slow, lift]), 1.0)
    assert "infeasible_constraints" not in found.began
    assert np.all(np.diff(found.setpoints["margin"]) > 0.0)
    assert np.abs(found.speeds).max() <= 0.1 * (1 + 1e-9)


@pytest.mark.parametrize("kind", ["Clouded", "Blurred"])
def test_a_constraint_that_is_no_number_for_a_while_stops_the_robot_and_lets_it_go_on(kind):
    found = run(
        settings(constraints=[SPEED, RANGE, {"constraint": f"nan_constraints:{kind}"}]), 1.0
    )
    assert found.began["bad_input"] == 1
    assert np.isfinite(found.speeds).all()
    assert np.abs(found.speeds[150:298]).max() == 0.0
    begin = int(np.flatnonzero(found.setpoints["solver_status"] == 3)[0])
    stop = np.abs(found.speeds[begin - 1 : begin + 12]).max(axis=1)
    assert stop[0] > 0.1
    assert np.diff(stop).min() >= -0.04 * (1 + 1e-9)  # 40 rad/s² on HOAP-3, and no jump
    assert found.setpoints["v"][-1] < found.setpoints["v"][290]


def test_constraints_that_contradict_each_other_in_motion_are_a_stop_and_no_jump():
    """The ZMP against the polygon's edge: all joints brake together, in a line, until at rest."""
    zmp = {"constraint": "zmp"}
    found = run(
        settings(
            "com_tracking",
            task=com(kind="point", position_m=BEYOND),
            constraints=[SPEED, RANGE, POLYGON, zmp],
        ),
        1.0,
    )
    stuck = found.setpoints["solver_status"] == 3
    assert found.began["infeasible_constraints"] >= 1
    assert changes(found).max() < 0.1
    first = int(np.flatnonzero(stuck)[0])
    ends = first + int(np.argmin(stuck[first:]))
    speeds = found.speeds[first - 1 : ends]
    fastest = np.abs(speeds).max(axis=1)
    assert fastest[0] > 0.1
    np.testing.assert_allclose(np.diff(fastest)[:-1], -0.04, rtol=1e-9)  # 40 rad/s² on HOAP-3
    assert fastest[-1] == 0.0
    direction = speeds[:-1] / fastest[:-1, None]
    np.testing.assert_allclose(direction, direction[:1].repeat(len(direction), 0), atol=1e-9)
