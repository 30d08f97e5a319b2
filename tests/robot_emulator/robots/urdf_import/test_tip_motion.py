"""The tip of a vendor's robot goes where its default task says, as `hoap3 run --robot` has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.urdfs.example_robots import MOVING, REFUSED
from support.urdfs.vendor_arm import vendor_folder

from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.tools.simulate import simulate

pytestmark = pytest.mark.filterwarnings("ignore::hoap3.protocol.errors.UrdfWarning")

NEAR_M = 1e-3
EXCLUDED = {"iris_description/robots/iris.urdf": "its joints turn rotors about their origins"}


def final_error(path: Path, duration: float) -> float:
    """How far the tip ends from its target [m], from the positions that the robot measured."""
    robot = import_robot(path).description
    task, dynamics = robot.default_task, Dynamics(robot)
    assert task is not None
    assert task.move_m is not None
    joint, placed = dynamics.carrier(task.point)

    def tip(q: np.ndarray) -> np.ndarray:
        dynamics.place(np.array(q), np.zeros(robot.n))
        rotation, origin = dynamics.placement(joint)
        return origin + rotation @ placed[:, 3]

    target = tip(robot.initial_position) + task.move_m
    run = simulate(str(path), "qp12", duration)
    return float(np.linalg.norm(tip(run.states["q"][-1]) - target))


def test_the_tip_of_a_small_arm_arrives(tmp_path):
    assert final_error(vendor_folder(tmp_path), 5.0) < NEAR_M


@pytest.mark.long
def test_the_tips_of_nearly_all_vendors_robots_arrive():
    errors = {}
    for name in sorted(MOVING.keys() - REFUSED.keys() - EXCLUDED.keys()):
        errors[name] = final_error(MOVING[name], 15.0)
        print(f"{1e3 * errors[name]:8.3f} mm  {name}")
    for name, cause in (REFUSED | EXCLUDED).items():
        print(f"  excluded  {name}: {cause}")
    assert sum(error < NEAR_M for error in errors.values()) >= 55
