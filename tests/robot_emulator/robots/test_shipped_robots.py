"""What every robot that we ship has to be; and the arms against kinematics published elsewhere."""

from __future__ import annotations

from functools import cache
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.robot_emulator.robots import available, load
from hoap3.testing import RobotProperties

X, Y, Z = np.eye(3)


@cache
def robot(name: str) -> RobotDescription:
    return load(name)


@cache
def model(name: str) -> RobotModel:
    return build_model(robot(name))


every = pytest.mark.parametrize("name", available())
dynamic = pytest.mark.parametrize("name", [name for name in available() if name != "hoap3"])


def in_pinocchios_order(name: str, q: np.ndarray) -> np.ndarray:
    there = np.empty(robot(name).n)
    there[model(name).order] = q
    return there


def placed(name: str, frame: str, q: np.ndarray) -> np.ndarray:
    """Where a frame is in the root link, (4, 4)."""
    built = model(name)
    pin.framesForwardKinematics(built.model, built.data, in_pinocchios_order(name, q))
    return built.data.oMf[built.frame_id(frame)].homogeneous.copy()


def gravity(name: str, q: np.ndarray) -> np.ndarray:
    """What the joints must hold at rest, in wire order [N m]."""
    built = model(name)
    there = in_pinocchios_order(name, q)
    return pin.computeGeneralizedGravity(built.model, built.data, there)[built.order]


def moved(axis: np.ndarray, angle: float, *offset: float) -> np.ndarray:
    """A shift, then a turn about an axis of the moving frame, (4, 4); Rodrigues."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    T[:3, 3] = offset if offset else (0, 0, 0)
    return T


def product(*transforms: np.ndarray) -> np.ndarray:
    return np.linalg.multi_dot(transforms)


def random_postures(name: str, count: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    return rng.uniform(robot(name).lower, robot(name).upper, (count, robot(name).n))


class TestShipped(RobotProperties):
    cases = tuple(available())

    def test_every_one_has_inertias(self):
        for case in self.cases:
            assert list(ET.fromstring(robot(case).urdf).iter("inertia"))


@every
def test_its_name_is_that_of_its_folder(name):
    assert robot(name).name == name


@dynamic
def test_it_takes_accelerations_and_torques(name):
    assert robot(name).command_kinds == ("position", "acceleration", "torque")


@every
def test_every_link_that_weighs_has_a_shape_to_draw_and_to_collide(name):
    for link in ET.fromstring(robot(name).urdf).findall("link"):
        for use in ("visual", "collision"):
            assert len(link.findall(use)) == (link.find("inertial") is not None)


@dynamic
def test_it_starts_away_from_limits_and_singularities_and_can_hold_itself(name):
    q = robot(name).initial_position
    away = np.minimum(q - robot(name).lower, robot(name).upper - q)
    assert np.all(away > 0.1)
    assert np.all(np.abs(gravity(name, q)) < 0.6 * robot(name).effort)
    built = model(name)
    for tip in {"ee", "tool0", "left_gripper", "right_gripper"} & set(robot(name).frames):
        there = in_pinocchios_order(name, q)
        J = pin.computeFrameJacobian(built.model, built.data, there, built.frame_id(tip))
        assert np.linalg.svd(J, compute_uv=False)[-1] > 0.05


def test_the_ur5_is_that_of_its_published_table():
    """Denavit-Hartenberg parameters of Universal Robots' manual, UR5 series 3."""
    a = [0, -0.425, -0.39225, 0, 0, 0]
    d = [0.089159, 0, 0, 0.10915, 0.09465, 0.0823]
    alpha = np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2
    for q in random_postures("ur5", 50):
        T = np.eye(4)
        for angle, length, offset, twist in zip(q, a, d, alpha, strict=True):
            T = product(T, moved(Z, angle, 0, 0, offset), moved(X, twist, length, 0, 0))
        np.testing.assert_allclose(placed("ur5", "tool0", q), T, rtol=0, atol=1e-12)


def test_the_lwr_is_that_of_its_data_sheet():
    """0.3105, 0.4, 0.39 and 0.078 m between shoulder, elbow, wrist and flange, all in one line."""
    signs = [1, -1, 1, 1, 1, -1, 1]
    for q in random_postures("lwr", 50):
        s = q * signs
        shoulder = product(moved(Z, s[0], 0, 0, 0.3105), moved(Y, s[1]), moved(Z, s[2]))
        elbow = product(shoulder, moved(Y, s[3], 0, 0, 0.4))
        flange = product(
            elbow, moved(Z, s[4]), moved(Y, s[5], 0, 0, 0.39), moved(Z, s[6], 0, 0, 0.078)
        )
        np.testing.assert_allclose(placed("lwr", "elbow", q), elbow, rtol=0, atol=1e-12)
        np.testing.assert_allclose(placed("lwr", "ee", q), flange, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_baxters_arms_are_those_of_their_data_sheet(side, sign):
    """69 mm from s0 to s1, 364 and 69 mm to the elbow, 374 and 10 mm to the wrist."""
    name = f"baxter_{side}_arm"
    mount = moved(Z, sign * 0.7854, 0.024645, sign * 0.219645, 0.118588)
    for q in random_postures(name, 50):
        shoulder = product(mount, moved(Z, q[0], 0.055695, 0, 0.011038), moved(Y, 0, 0, 0, 0.27035))
        upper_arm = product(shoulder, moved(Y, q[1], 0.069, 0, 0), moved(X, q[2]))
        elbow = product(upper_arm, moved(Y, q[3], 0.102 + 0.26242, 0, -0.069), moved(X, q[4]))
        wrist = product(elbow, moved(Y, q[5], 0.10359 + 0.2707, 0, -0.01), moved(X, q[6]))
        hand = 0.115975 + 0.11355 + 0.025 + 0.1327
        T = product(wrist, moved(Y, np.pi / 2, hand, 0, 0))
        there = placed(name, f"{side}_gripper", q)
        np.testing.assert_allclose(there[:3, 3], T[:3, 3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(there[:3, :3] @ Z, T[:3, :3] @ Z, rtol=0, atol=1e-10)


def test_the_humanoid_weighs_and_measures_what_the_table_of_men_says():
    """de Leva 1996: 73 kg, and from the soles to the vertex 1.741 m plus what the ankles add."""
    name = "humanoid32"
    assert model(name).total_mass == pytest.approx(73.0, rel=1e-5)
    upright = np.array(robot(name).postures["zero"])
    top, hip = placed(name, "head", upright)[2, 3] + 0.2429, placed(name, "r_thigh", upright)[2, 3]
    knee, ankle, sole = (
        placed(name, frame, upright)[2, 3] for frame in ("r_shank", "r_foot", "r_sole")
    )
    steps = [top - hip, hip - knee, knee - ankle, ankle - sole]
    np.testing.assert_allclose(steps, [0.6033 + 0.2429, 0.4222, 0.4340, 0.07], atol=1e-12)


def test_the_humanoid_is_its_own_mirror_image():
    name = "humanoid32"
    mirrored = ("yaw", "roll")
    names = list(robot(name).joint_names)
    other = {"r_": "l_", "l_": "r_"}
    swap = [names.index(other.get(one[:2], one[:2]) + one[2:]) for one in names]
    signs = np.array([-1.0 if one.endswith(mirrored) else 1.0 for one in names])
    np.testing.assert_array_equal(robot(name).lower[swap], np.where(
        signs < 0, -robot(name).upper, robot(name).lower
    ))  # fmt: skip
    for q in random_postures(name, 20):
        twin = np.where(signs < 0, -q[swap], q[swap])
        np.testing.assert_allclose(gravity(name, twin), signs * gravity(name, q)[swap], atol=1e-9)
        there, here = placed(name, "l_palm", twin)[:3, 3], placed(name, "r_palm", q)[:3, 3]
        np.testing.assert_allclose(there, here * [1, -1, 1], atol=1e-12)
