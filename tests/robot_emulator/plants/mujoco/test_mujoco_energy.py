"""Energy of a free swing of 10 s, which both simulators lose and gain alike."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.base import Plant
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.plants.rigid_body import RigidBody
from hoap3.robot_emulator.robots import load

ROBOTS = ("baxter_left_arm", "baxter_right_arm", "hoap3", "humanoid32", "lwr", "ur5")
SUBSTEPS = 4
FREE = -1e3, 1e3


def without_stops(name: str) -> RobotDescription:
    robot = load(name)
    low, high = FREE
    limits = {"lower_hard": low, "upper_hard": high, "lower": low, "upper": high}
    return robot.model_copy(
        update={
            "joints": tuple(joint.model_copy(update=limits) for joint in robot.joints),
            "command_kinds": ("torque",),
            "base_frame": robot.structure.root,
        }
    )


def hanging(robot: RobotDescription) -> np.ndarray:
    """Where gravity pulls no joint, by Newton's flow along −M⁻¹g."""
    dynamics, q, g = Dynamics(robot), robot.initial_position.copy(), np.zeros(robot.n)
    for _ in range(5000):
        dynamics.gravity(q, g)
        q -= 0.004 * np.linalg.solve(dynamics.mass(q) + 1e-3 * np.eye(robot.n), g)
    return q


def drift(robot: RobotDescription, plant: Plant, start: np.ndarray) -> float:
    """Largest change of the whole energy, relative to the largest kinetic one."""
    built = build_model(robot)
    q, dq, none = np.zeros(robot.n), np.zeros(robot.n), np.zeros(robot.n)
    plant.reset(start)
    kinetic, whole = [], []
    for tick in range(10000):
        if tick % 10 == 0:
            q[built.order], dq[built.order] = plant.q, plant.dq
            kinetic.append(pin.computeKineticEnergy(built.model, built.data, q, dq))
            whole.append(kinetic[-1] + pin.computePotentialEnergy(built.model, built.data, q))
        plant.step(none, 0.001)
    return float(np.abs(np.array(whole) - whole[0]).max() / max(kinetic))


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_free_swing_keeps_its_energy_as_well_in_both(name: str):
    """From 0.3 rad beside where it hangs, without friction; both are of first order in the step."""
    robot = without_stops(name)
    start = hanging(robot) + 0.3
    free = {"joint_friction": False, "collide": "none"}
    ours = drift(robot, RigidBody(robot, PlantSettings(friction=False, substeps=SUBSTEPS)), start)
    fine = MujocoPlant(robot, MujocoPlant.Parameters(**free, substeps=SUBSTEPS))
    theirs = drift(robot, fine, start)
    coarse = drift(robot, MujocoPlant(robot, MujocoPlant.Parameters(**free)), start)
    assert theirs == pytest.approx(ours, rel=0.01)
    assert ours < 0.025
    assert ours < coarse
