"""Compliant unilateral planes that points of a robot touch, and the sensors that feel them."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.protocol.robot.urdf import UrdfStructure
from hoap3.robot_emulator.config import ContactSettings


class Contacts:
    """Points against planes, after Kelvin and Voigt: a spring K and a damper D that only push.

    A point at the depth δ > 0 that moves away from its plane with v_n gets the normal force
    max(0, K·δ − D·v_n) and, against its sliding, the friction μ·f_n; outside there is none. Slower
    than `contact_kernels.CREEP` friction grows in proportion to the speed.

    Damper and friction act on the velocity after the step of h, with the robot's M and all other
    contacts, so that neither can shake a link, however light. A damper less than h·K counts as
    h·K: with it a spring of any stiffness gains nothing in a step (for D = h·K this is implicit
    Euler's method), and no body leaves a plane faster than it came.

    Args:
        description: of the robot; its `wrench_sensors` are what `feel` writes.
        settings: the planes; their frames are frames of the robot.
        dynamics: of the robot; its `place` is called.
    """

    def __init__(
        self,
        description: RobotDescription,
        settings: tuple[ContactSettings, ...],
        dynamics: Dynamics,
    ) -> None:
        from hoap3.robot_emulator.plants import contact_kernels as kernels

        self._touch, self._rows_of = kernels.touch, kernels.contact_rows
        self._push, self._react, self._sense = kernels.push, kernels.react, kernels.sense
        n, count, sensors = description.n, len(settings), description.wrench_sensors
        self._dynamics, order = dynamics, np.array(dynamics.robot.order, np.int64)
        self._mimic_joints = dynamics.mimic_joints
        frames = [each.frame for each in settings]
        carriers = [dynamics.carrier(frame) for frame in [*frames, *sensors]]
        bodies = sorted({joint for joint, _ in carriers})
        self._views = [dynamics.placement(joint) for joint in bodies]
        on_body = np.array([bodies.index(joint) for joint, _ in carriers], np.int64)
        on_joints = np.array([placed for _, placed in carriers])
        offsets = np.array([[*each.offset_m, 1.0] for each in settings])
        in_body = np.einsum("cij,cj->ci", on_joints[:count], offsets)
        mounts = np.ascontiguousarray(on_joints[count:])
        movers = np.array([dynamics.movers(frame) for frame in frames])
        axes = np.array([_axes(each.normal) for each in settings])
        levels = np.einsum("ci,ci->c", axes[:, 0], np.array([each.point_m for each in settings]))
        laws = np.array([each.law for each in settings])
        above = [_carrying(description.structure, frame) for frame in frames]
        carried = np.array([[sensor in links for links in above] for sensor in sensors], np.bool_)
        points, depths = np.zeros((count, 3)), np.zeros(count)
        self._places = np.zeros((len(bodies), 3, 4))
        rows, half = np.zeros((2, count, 3, n))
        self._rows, self._full_rows = rows, rows
        if self._mimic_joints is not None:
            self._full_rows = np.zeros((count, 3, len(order)))
        self._forces, self._torque, self._none = np.zeros((count, 3)), np.zeros(n), np.zeros(n)
        # what the kernels take
        self._planes = self._places, on_body[:count], in_body, axes, levels, points, depths
        self._jacobians = dynamics.joint_jacobian, order, movers, axes, points, self._full_rows
        self._masses = dynamics.inertia, dynamics.inertia_order
        self._touched = rows, depths, laws
        self._scratch = np.zeros((n, n)), half, np.zeros((count, count, 3, 3))
        felt = carried.reshape(len(sensors), count)
        self._sensors = self._places, on_body[count:], mounts, felt, points, axes, self._forces

    def push(
        self, q: FloatArray, dq: FloatArray, added: FloatArray, h: float, ddq: FloatArray
    ) -> None:
        """Add to `ddq` what contacts give in a step of `h` [s]; all arrays (n,).

        Args:
            q, dq: at the begin of the step [rad, rad/s or m, m/s].
            added: on the diagonal of M [kg m² or kg].
            h: length of the step.
            ddq: accelerations without contact, changed in place [rad/s² or m/s²].
        """
        if self._find(q, added):
            self._push(*self._masses, *self._touched, dq, h, *self._scratch, self._forces, ddq)

    def torques(self, q: FloatArray, dq: FloatArray, h: float) -> FloatArray:
        """Torques of the forces that a step to the velocities `dq` has; a view, (n,) [N m or N].

        Args:
            q: positions at the begin of the step, (n,).
            dq: velocities at its end, (n,); 0 for a robot that stands.
            h: its length [s].
        """
        if self._find(q, self._none):
            self._react(*self._touched, dq, h, self._forces, self._torque)
        else:
            self._torque[:] = 0.0
        return self._torque

    def feel(self, share: float, wrench: FloatArray) -> None:
        """Add `share` of what sensors measure of the forces found last.

        Args:
            share: of the whole.
            wrench: (6 per sensor) force [N] and torque [N m] that the surroundings exert on the
                sensor's link and all that it carries, about the sensor's origin, in its axes.
        """
        self._sense(*self._sensors, share, wrench)

    def _find(self, q: FloatArray, added: FloatArray) -> bool:
        """Whether anything touches; where it does, the rows are up to date."""
        self._dynamics.place(q, added)
        for place, (rotation, origin) in zip(self._places, self._views, strict=True):
            place[:, :3] = rotation
            place[:, 3] = origin
        if not self._touch(*self._planes):
            self._forces[:] = 0.0
            return False
        self._rows_of(*self._jacobians)
        if self._mimic_joints is not None:
            self._mimic_joints.columns(self._full_rows, self._rows)
        return True


def _axes(normal: tuple[float, float, float]) -> FloatArray:
    """The unit normal and two tangents, one a row, (3, 3)."""
    n = np.array(normal) / math.hypot(*normal)
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(n)))], n)
    first /= np.linalg.norm(first)
    return np.array([n, first, np.cross(n, first)])


def _carrying(structure: UrdfStructure, link: str) -> set[str]:
    """A link and all that carry it."""
    parents = {joint.child: joint.parent for joint in structure.joints}
    links = {link}
    while link in parents:
        link = parents[link]
        links.add(link)
    return links
