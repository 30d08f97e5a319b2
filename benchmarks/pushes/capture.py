"""The push that a robot on its soles can catch without a step, in plain numpy and scipy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.constraints.support.polygon import half_planes, hull
from hoap3.remote_controller.controllers.acceleration.soles.outlines import drawn_in
from hoap3.remote_controller.model.frame_dynamics import POSE, FrameRows
from hoap3.remote_controller.model.free_dynamics import BASE, FreeDynamics
from hoap3.remote_controller.solvers.contact.wrench_cone import wrench_cone

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Stance:
    """A robot at rest on its soles.

    Attributes:
        robot: its description.
        base, q: State.base (13,) and joint positions (n,).
        friction, margin_m: that its controller counts on.
    """

    robot: RobotDescription
    base: Array
    q: Array
    friction: float
    margin_m: float

    def dynamics(self) -> FreeDynamics:
        """Of the soles, 6 rows each, and below them of the centre of mass."""
        soles = self.robot.soles
        rows = [FrameRows(sole.frame, POSE * i, POSE) for i, sole in enumerate(soles)]
        rows.append(FrameRows(COM, POSE * len(soles), 3))
        found = FreeDynamics(self.robot, rows, POSE * len(soles) + 3)
        found.base[:] = self.base
        found.base[7:] = 0.0
        found.update(self.q, np.zeros(self.robot.n))
        return found


def room(stance: Stance, angle: float) -> float:
    """d: from the CoM's projection along a direction to the edge of both soles' outline [m].

    Args:
        stance: where the robot stands; its margin is taken off the soles.
        angle: of the direction, from the world's x [rad].
    """
    dynamics, corners = stance.dynamics(), []
    for i, sole in enumerate(stance.robot.soles):
        outline = drawn_in(sole.polygon, stance.margin_m)
        axes, origin = dynamics.rotations[i], dynamics.origins[i]
        corners.append(outline @ axes[:2, :2].T + origin[:2])
    normals, offsets = half_planes(hull(np.concatenate(corners)))
    along = normals @ [math.cos(angle), math.sin(angle)]
    ahead = along < 0.0
    return float(((offsets - normals @ dynamics.com[:2])[ahead] / along[ahead]).min())


def impulse(stance: Stance, distance_m: float) -> float:
    """m·√(g/z)·d [N s]: after such a push the divergent component is `distance_m` ahead."""
    dynamics = stance.dynamics()
    height = dynamics.com[2] - float(dynamics.origins[: len(stance.robot.soles), 2].mean())
    return float(dynamics.total_mass * math.sqrt(GRAVITY / height) * distance_m)


def room_by_torques(stance: Stance, angle: float) -> float:
    """The same d as far as torques, cones and contacts let the ground's forces act there [m].

    The greatest s of: the centre of mass accelerates by −s·g/z along the direction, not upwards,
    and no angular momentum changes, in this posture, at rest, within torques and cones. A linear
    program of v̇, the wrenches and s.
    """
    robot, dynamics = stance.robot, stance.dynamics()
    s, n = len(robot.soles), robot.n
    width, count = n + BASE, POSE * s
    J, drift = dynamics.jacobian[:count], dynamics.drift[:count]
    com, com_drift = dynamics.jacobian[count:], dynamics.drift[count:]
    height = dynamics.com[2] - float(dynamics.origins[:s, 2].mean())
    fall = GRAVITY / height * np.array([math.cos(angle), math.sin(angle), 0.0])
    spin = np.zeros((3, count))
    for i in range(s):
        axes, lever = dynamics.rotations[i], dynamics.origins[i] - dynamics.com
        spin[:, POSE * i : POSE * i + 3] = np.cross(lever, axes.T).T
        spin[:, POSE * i + 3 : POSE * (i + 1)] = axes
    M, h = dynamics.mass, dynamics.bias
    equal = np.vstack(
        [
            np.hstack([J, np.zeros((count, count + 1))]),
            np.hstack([M[:BASE], -J[:, :BASE].T, np.zeros((BASE, 1))]),
            np.hstack([com, np.zeros((3, count)), fall[:, None]]),
            np.hstack([np.zeros((3, width)), spin, np.zeros((3, 1))]),
        ]
    )
    sides = np.concatenate([-drift, -h[:BASE], -com_drift, np.zeros(3)])
    torque = np.hstack([M[BASE:], -J[:, BASE:].T, np.zeros((n, 1))])
    rows, most = [torque, -torque], [robot.effort - h[BASE:], robot.effort + h[BASE:]]
    for i, sole in enumerate(robot.soles):
        cone = wrench_cone(drawn_in(sole.polygon, stance.margin_m), stance.friction)
        place = np.zeros((len(cone), width + count + 1))
        place[:, width + POSE * i : width + POSE * (i + 1)] = cone
        rows.append(place)
        most.append(np.zeros(len(cone)))
    cost = np.zeros(width + count + 1)
    cost[-1] = -1.0
    found = linprog(cost, np.vstack(rows), np.concatenate(most), equal, sides, bounds=(None, None))
    return float(found.x[-1]) if found.status == 0 else 0.0
