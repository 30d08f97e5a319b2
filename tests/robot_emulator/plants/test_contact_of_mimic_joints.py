"""Contact of a robot with a mimic joint: a telescope, whose second stage goes r times as far."""

from __future__ import annotations

import numpy as np
import pytest
from touching import T, floor, touching

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe

GRAVITY = 9.81
FIRST, SECOND = 1.5, 0.8  # kg
RATIOS = (-3.0, 0.5, 2.0)
each_ratio = pytest.mark.parametrize("ratio", RATIOS)


def telescope(ratio: float) -> RobotDescription:
    """Masses at z = q and z = (1 + r)·q; a sensor on the second."""
    links, joints = ['<link name="root"/>'], []
    for name, mass in (("first", FIRST), ("second", SECOND)):
        links.append(
            f'<link name="{name}"><inertial><mass value="{mass}"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    for name, parent, mimic in (
        ("first", "root", ""),
        ("second", "first", f'<mimic joint="to_first" multiplier="{ratio}"/>'),
    ):
        joints.append(
            f'<joint name="to_{name}" type="prismatic"><parent link="{parent}"/>'
            f'<child link="{name}"/><axis xyz="0 0 1"/>{mimic}'
            '<limit lower="-500" upper="500" velocity="900" effort="10000"/></joint>'
        )
    file = RobotFile(
        name="telescope",
        urdf="telescope.urdf",
        command_kinds=("torque",),
        wrench_sensors=("second",),
        brake_acceleration=1e3,
    )
    return describe(file, f'<robot name="telescope">{"".join(links)}{"".join(joints)}</robot>')


@each_ratio
def test_in_free_fall_both_masses_weigh_by_how_far_they_go(ratio):
    """(m₁ + m₂(1 + r)²)·q̈ = τ − (m₁ + m₂(1 + r))·g."""
    body, tau = touching(telescope(ratio)), np.array([3.0])
    body.step(tau, T)
    inertia = FIRST + SECOND * (1.0 + ratio) ** 2
    weight = (FIRST + SECOND * (1.0 + ratio)) * GRAVITY
    assert body.dq[0] / T == pytest.approx((3.0 - weight) / inertia, rel=1e-12)


@each_ratio
def test_at_rest_the_floor_carries_what_the_telescope_makes_of_the_weight(ratio):
    """f·(1 + r) = (m₁ + m₂(1 + r))·g − τ, at a depth of f/K."""
    body = touching(telescope(ratio), floor("second", stiffness_n_m=2e4))
    push = np.array([40.0 if ratio < -1.0 else 0.0])  # the second mass goes down as the first rises
    for _ in range(700):
        body.step(push, T)
    force = ((FIRST + SECOND * (1.0 + ratio)) * GRAVITY - push[0]) / (1.0 + ratio)
    assert force > 0.0
    np.testing.assert_allclose(body.wrench, [0, 0, force, 0, 0, 0], rtol=1e-6, atol=1e-6)
    assert (1.0 + ratio) * body.q[0] == pytest.approx(-force / 2e4, rel=1e-6)
    assert abs(body.dq[0]) < 1e-9


@each_ratio
def test_the_torque_of_a_contact_lifts_nothing_but_what_touches(ratio):
    """With its brakes on at a depth δ the joint carries the weight less (1 + r)·K·δ."""
    body = touching(telescope(ratio), floor("second", stiffness_n_m=2e4))
    q = -0.001 / (1.0 + ratio)
    body.reset(np.array([q]))
    weight = (FIRST + SECOND * (1.0 + ratio)) * GRAVITY
    assert body.tau[0] == pytest.approx(weight - (1.0 + ratio) * 2e4 * 0.001, rel=1e-12)
