"""The URDFs of `example-robot-data`: they load, with their joints, and move as Pinocchio has it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from support.urdfs.example_robots import EXAMPLES, FEW, MOVING, REFUSED, joints

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

TURN = 7.0  # rad: of joints without end
TOLERANCE = 1e-12


class Plain:
    """Forward kinematics of the vendor's file by Pinocchio alone, <mimic> by hand."""

    def __init__(self, path: Path) -> None:
        self.model = pin.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.file = joints(path)

    def position(self, name: str, given: dict[str, float]) -> float:
        """Of a joint of the file, by those that follow no other; 0 of what does not move."""
        if name not in self.file:
            return 0.0
        mimic = self.file[name].find("mimic")
        if mimic is None:
            return given[name]
        ratio, offset = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
        return ratio * self.position(mimic.attrib["joint"], given) + offset

    def place(self, given: dict[str, float]) -> None:
        """Put the joints where they are given."""
        q = np.zeros(self.model.nq)
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            angle = self.position(name, given)
            at = slice(joint.idx_q, joint.idx_q + joint.nq)
            q[at] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        pin.framesForwardKinematics(self.model, self.data, q)

    def link(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and origin of a link."""
        placement = self.data.oMf[self.model.getFrameId(name, pin.FrameType.BODY)]
        return placement.rotation, placement.translation


def random_positions(robot: RobotDescription, rng: np.random.Generator) -> np.ndarray:
    lower = np.where(np.isfinite(robot.lower), robot.lower, -TURN)
    upper = np.where(np.isfinite(robot.upper), robot.upper, TURN)
    return rng.uniform(lower, upper)


def greatest_difference(robot: RobotDescription, path: Path, postures: int) -> float:
    """Of any rotation or origin of any link, over random postures."""
    plain = Plain(path)
    ours, rng = Dynamics(robot), np.random.default_rng(0)
    carriers = {link: ours.carrier(link) for link in robot.frames}
    worst = 0.0
    for _ in range(postures):
        q = random_positions(robot, rng)
        ours.place(q, np.zeros(robot.n))
        plain.place(dict(zip(robot.joint_names, q.tolist(), strict=True)))
        for link, (joint, placed) in carriers.items():
            rotation, origin = plain.link(link)
            turn, at = ours.placement(joint)
            worst = max(
                worst,
                float(np.abs(turn @ placed[:, :3] - rotation).max()),
                float(np.abs(turn @ placed[:, 3] + at - origin).max()),
            )
    return worst


def check_joints(robot: RobotDescription, path: Path) -> None:
    """The joints are those of the file, in its order, less those that follow others."""
    file = joints(path)
    independent = [name for name, joint in file.items() if joint.find("mimic") is None]
    assert list(robot.joint_names) == independent
    assert set(robot.structure.mimic_joints) == file.keys() - set(independent)
    assert set(robot.frames) == {
        link.get("name") for link in ET.parse(path).getroot().findall("link")
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_a_vendors_robot_has_its_joints_and_moves_as_pinocchio_says(name):
    robot = import_robot(MOVING[name]).description
    check_joints(robot, MOVING[name])
    assert greatest_difference(robot, MOVING[name], 10) < TOLERANCE


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(MOVING.keys() - REFUSED.keys()))
def test_every_vendors_robot_has_its_joints_and_moves_as_pinocchio_says(name):
    robot = import_robot(MOVING[name]).description
    check_joints(robot, MOVING[name])
    difference = greatest_difference(robot, MOVING[name], 1000)
    print(f"{name}: {difference:.1e}")
    assert difference < TOLERANCE


@pytest.mark.parametrize("name", sorted(EXAMPLES.keys() - MOVING.keys() | REFUSED.keys()))
def test_what_does_not_load_says_why(name):
    said = REFUSED.get(name, "joint|<link>")
    with pytest.raises(DescriptionError, match=said):
        import_robot(EXAMPLES[name])
