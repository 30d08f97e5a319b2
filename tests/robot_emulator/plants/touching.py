"""Robots that touch things: masses on straight guides, of which everything is known, and an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from support.arm3 import joint

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.rigid_body import RigidBody
from hoap3.robot_emulator.robots import load

T = 0.001
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def guided(axes: str, masses: Sequence[float], gravity: str = "none") -> RobotDescription:
    """Masses, each on a straight guide on the one before; a sensor on the last, and on the root.

    So M is diagonal: a joint moves its own mass and those after it.
    """
    links, parent = ['<link name="root"/>'], "root"
    for name, mass in zip(axes, masses, strict=True):
        links.append(
            f'<link name="{name}_slide"><inertial><mass value="{mass}"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="prismatic"><parent link="{parent}"/>'
            f'<child link="{name}_slide"/><axis xyz="{AXES[name]}"/>'
            '<limit lower="-50" upper="50" velocity="100" effort="10000"/></joint>'
        )
        parent = f"{name}_slide"
    wide = {"lower_hard": -50.0, "upper_hard": 50.0, "lower": -50.0, "upper": 50.0}
    strong = {"velocity": 100.0, "effort": 1e4, "brake_acceleration": 1e3}
    return RobotDescription(
        name="guided",
        urdf=f'<robot name="guided">{"".join(links)}</robot>',
        joints=tuple(joint(name, **wide, **strong) for name in axes),
        initial_posture="zero",
        postures={"zero": (0.0,) * len(axes)},
        base_frame="root",
        command_kinds=("torque",),
        gravity=gravity,
        wrench_sensors=(parent, "root"),
    )


def arm(gravity: str = "none", **changes: object) -> RobotDescription:
    """The LWR-like arm under torques, with a sensor inside the arm too."""
    sensors = {"wrench_sensors": ("ee", "link_4", "base")}
    fields = {"command_kinds": ("torque",), "gravity": gravity, **sensors, **changes}
    return load("lwr").model_copy(update=fields)


def touching(
    description: RobotDescription, *contacts: Mapping[str, object], substeps: int = 4
) -> RigidBody:
    """A body without friction in its joints, at its initial posture."""
    settings = PlantSettings(contacts=contacts, substeps=substeps, friction=False)
    body = RigidBody(description, settings)
    body.reset(description.initial_position)
    return body


def floor(frame: str, **changes: object) -> dict[str, object]:
    """A level plane through the root."""
    return {"frame": frame, "point_m": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 1.0), **changes}


def force(body: RigidBody) -> np.ndarray:
    """Of all contacts on the robot in the last period, in the root's axes, (3,) [N].

    The last sensor is that on the root, which feels them all.
    """
    return body.wrench[-6:-3].copy()
