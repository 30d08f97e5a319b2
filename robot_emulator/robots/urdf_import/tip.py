"""What a robot does whose file names no task: its tip moves a little, to where it can be.

The tip is the link with the most moving joints above it. The target is where the tip comes to when
every joint above it turns a little, away from its nearer limit: so there is a posture in which it
is there, all limits kept, even where the arm is stretched out, or has one joint only.
"""

from __future__ import annotations

import numpy as np

from hoap3.protocol.description import DefaultTask, RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.protocol.urdf import UrdfStructure
from hoap3.robot_emulator.robots.urdf_import.joints import SPEED

MOVE_M = 0.05  # far enough to be seen, near enough for a straight way
LEAST_MOVE_M = 1e-3  # a tip that moves less is none
MOST_TURN = 1.0  # rad, or a tenth of it in m: of each joint
SHARE = 0.5  # of a joint's room to its farther limit that may be used
STEPS = 200
DIGITS = 6  # of the target [m]


def chains(structure: UrdfStructure) -> dict[str, tuple[str, ...]]:
    """By link, the moving joints above it, from the root on."""
    above: dict[str, tuple[str, ...]] = {structure.root: ()}
    waiting = list(structure.joints)
    while waiting:  # a joint may stand before the one that carries it
        later = []
        for joint in waiting:
            if joint.parent in above:
                own = (joint.name,) if joint.name in structure.moved else ()
                above[joint.child] = above[joint.parent] + own
            else:
                later.append(joint)
        waiting = later
    return above


def candidates(structure: UrdfStructure) -> list[str]:
    """Links that move, the one with the most moving joints above it first; ties as in the file."""
    above = chains(structure)
    moving = [link for link in structure.links if above[link]]
    return sorted(moving, key=lambda link: -len(above[link]))


def default_task(robot: RobotDescription) -> DefaultTask | None:
    """Move the tip by up to `MOVE_M`, as seen from the root; None where no tip can be moved."""
    dynamics, structure = Dynamics(robot), robot.structure
    above = chains(structure)
    for link in candidates(structure):
        move = _small_move(robot, dynamics, link, _masters(structure, above[link]))
        if np.linalg.norm(move) >= LEAST_MOVE_M:
            x, y, z = np.round(move, DIGITS).tolist()
            return DefaultTask(point=link, reference=structure.root, move_m=(x, y, z))
    return None


def _masters(structure: UrdfStructure, joints: tuple[str, ...]) -> list[str]:
    """The joints with a setpoint that move these."""
    followers = structure.followers
    return [followers[name].master if name in followers else name for name in joints]


def _small_move(
    robot: RobotDescription, dynamics: Dynamics, link: str, joints: list[str]
) -> FloatArray:
    """How a link's origin moves as its joints turn together, until it has gone `MOVE_M`, (3,)."""
    start = np.array(robot.initial_position)
    up, down = robot.upper - start, start - robot.lower
    speeds = np.array([SPEED[robot.structure.moved[name].kind] for name in robot.joint_names])
    turn = np.minimum(MOST_TURN * speeds, SHARE * np.maximum(up, down))
    turn *= np.where(up >= down, 1.0, -1.0) * np.isin(robot.joint_names, joints)
    here = _origin(dynamics, link, start)
    move = np.zeros(3)
    for part in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        further = _origin(dynamics, link, start + part * turn) - here
        if np.linalg.norm(further) > MOVE_M:
            break
        move = max(move, further, key=np.linalg.norm)
    return move


def _origin(dynamics: Dynamics, link: str, q: FloatArray) -> FloatArray:
    """Where a link's origin is, as seen from the root, (3,) [m]."""
    dynamics.place(q, np.zeros(dynamics.n))
    joint, placed = dynamics.carrier(link)
    rotation, origin = dynamics.placement(joint)
    return np.asarray(origin + rotation @ placed[:, 3])
