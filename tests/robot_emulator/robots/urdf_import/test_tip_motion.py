"""The tip of a vendor's robot goes where its default task says, as `hoap3 run --robot` has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.urdfs.example_robots import MOVING, REFUSED
from support.urdfs.vendor_arm import vendor_folder

from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.tools.services.simulate import simulate

pytestmark = pytest.mark.filterwarnings("ignore::hoap3.protocol.errors.UrdfWarning")

NEAR_M, NEAR_IN_PHYSICS_M = 1e-3, 1e-2
EXCLUDED = {"iris_description/robots/iris.urdf": "its joints turn rotors about their origins"}


def final_error(path: Path, duration: float, plant: str = "servo") -> tuple[float, bool]:
    """How far the tip ends from its target [m], from the positions that the robot measured.

    Returns:
        That, and whether a motor was at its effort all the time.
    """
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
    run = simulate({"robot": str(path), "plant": {"kind": plant}}, "qp12", duration)
    spent = np.abs(run.states["tau"]) >= (1.0 - 1e-3) * robot.effort
    error = float(np.linalg.norm(tip(run.states["q"][-1]) - target))
    return error, bool(spent.any(1).mean() > 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["servo", "mujoco"])
def test_the_tip_of_a_small_arm_arrives(plant, tmp_path):
    error, _ = final_error(vendor_folder(tmp_path), 5.0, plant)
    assert error < NEAR_M


@pytest.mark.long
@pytest.mark.parametrize(
    ("plant", "duration", "near", "least"),
    [("servo", 15.0, NEAR_M, 55), ("mujoco", 5.0, NEAR_IN_PHYSICS_M, 45)],
)
def test_the_tips_of_nearly_all_vendors_robots_arrive(plant, duration, near, least):
    arrived = 0
    for name in sorted(MOVING.keys() - REFUSED.keys() - EXCLUDED.keys()):
        error, spent = final_error(MOVING[name], duration, plant)
        arrived += error < near
        cause = "a motor has not the effort to hold it" if spent else "not there yet"
        print(f"{1e3 * error:8.3f} mm  {name}{'' if error < near else f': {cause}'}")
    for name, why in (REFUSED | EXCLUDED).items():
        print(f"  excluded  {name}: {why}")
    assert arrived >= least
