"""Where the robot of an MJCF file differs from the description that controllers have."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.plants.mujoco.model import MujocoModel

NEAR = ALIGNED = SUNK = 1e-3  # m, and of a unit vector: less is rounding, or a contact at rest
HEAVIER = 0.02  # of the moving mass
BENT = 0.3  # rad or m at most from the start posture, so that no axes are parallel by chance


def differences(mujoco: Any, built: MujocoModel, description: RobotDescription) -> list[str]:
    """Joints and links that are elsewhere in the file than in the description, and other masses.

    Args:
        mujoco, built: module, and model of the file.
        description: of the robot; the root link's axes are those of its body, else the world's.

    Returns:
        A text each, such as `elbow by 0.3 m`.
    """
    model, data, dynamics = built.model, mujoco.MjData(built.model), Dynamics(description)
    n, structure = description.n, description.structure
    q = description.initial_position + np.resize([BENT, -BENT], n) / np.arange(1, n + 1)
    q = np.clip(q, description.lower, description.upper)
    built.pose(data, q)
    mujoco.mj_kinematics(model, data)
    dynamics.place(q, np.zeros(n))
    bodies = {model.body(number).name: number for number in range(model.nbody)}
    root = bodies.get(structure.root, built.root)
    axes, origin = data.xmat[root].reshape(3, 3), data.xpos[root]
    columns = dynamics.joint_jacobian[:, dynamics.robot.order]
    found = []
    for name, column in zip(description.joint_names, columns.T, strict=False):
        part = slice(0, 3) if structure.moved[name].kind == "prismatic" else slice(3, 6)
        if np.abs(column[part] - axes.T @ data.xaxis[model.joint(name).id]).max() > ALIGNED:
            found.append(f"{name} has another axis")
    for link in [each for each in structure.links if each in bodies and each in structure.moving]:
        carrier, placed = dynamics.carrier(link)
        rotation, place = dynamics.placement(carrier)
        there = axes.T @ (data.xpos[bodies[link]] - origin)
        away = float(np.linalg.norm(place + rotation @ placed[:, 3] - there))
        if away > NEAR:
            found.append(f"{link} by {away:.3g} m")
    ours = dynamics.robot.total_mass - (0.0 if built.free else dynamics.robot.root_mass)
    moving = np.isin(model.body_rootid, built.trees) & (model.body_weldid > 0)
    theirs = float(model.body_mass[moving].sum())
    if abs(theirs - ours) > HEAVIER * max(ours, theirs):
        found.append(f"{theirs:.4g} kg move instead of {ours:.4g} kg")
    return found


def sunk(model: Any, data: Any) -> list[str]:
    """Bodies that are inside what stands still, such as the floor, a text each."""
    found: dict[str, float] = {}
    for contact in data.contact[: data.ncon]:
        bodies = [body for body in model.geom_bodyid[contact.geom] if model.body_weldid[body]]
        if contact.dist < -SUNK and len(bodies) == 1:
            name = model.body(bodies[0]).name
            found[name] = max(found.get(name, 0.0), -float(contact.dist))
    return [f"{name} by {depth:.3g} m" for name, depth in found.items()]
