"""Where the points of a robot are, and how they move, by Pinocchio's own functions."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Messages

Array = NDArray[np.float64]


class Robot:
    """A robot at one joint position; all results are in wire order, in a reference frame's axes.

    Args:
        description: of the robot.
        messages: of its controller's live targets; None where they were not collected.

    Attributes:
        description, messages: what it was made from.
        model, data: Pinocchio's.
        G, g0: (m, n) and (m,), of q_pinocchio = G·q + g₀: joints of the wire, and their mimic
            joints.
        positions: joint positions, (n,) [rad or m], in wire order.
        width: columns of Jacobians, n.
    """

    def __init__(self, description: RobotDescription, messages: Messages | None = None) -> None:
        self.description, self._built = description, build_model(description)
        self.messages, self.width = messages, description.n
        self.model, self.data = self._built.model, self._built.data
        self.G, self.g0 = mimic_matrix(description, self.model)
        self.q, self.positions = np.zeros(self.model.nq), np.zeros(description.n)
        self._v = np.zeros(self.model.nv)

    def known(self, frame: str) -> str:
        """The name of a frame, if the robot has it.

        Raises:
            FrameNotFoundError: it has not.
        """
        self._built.frame_id(frame)
        return frame

    def moves(self, frame: str, reference: str) -> NDArray[np.bool_]:
        """Whether each joint moves a frame as seen from another, (n,), by how they are linked.

        A joint of the wire does where it or a mimic joint of its does.
        """
        found = np.zeros(self.model.nv, bool)
        for name in (frame, reference):
            joint = self.model.frames[self._built.frame_id(name)].parentJoint
            above = [each for each in self.model.supports[joint] if each > 0]  # 0 is the world
            found[[self.model.joints[each].idx_v for each in above]] ^= True
        return np.asarray((self.G[found] != 0.0).any(axis=0))

    def place(self, q: Array) -> None:
        """Take joint positions, (n,) [rad or m]."""
        self.positions = np.array(q, float)
        self.q = self.G @ self.positions + self.g0
        pin.computeJointJacobians(self.model, self.data, self.q)
        pin.updateFramePlacements(self.model, self.data)

    def place_only(self, q: Array) -> None:
        """Take joint positions for `com_point` and `pose` alone, which need no Jacobians."""
        self.positions = np.array(q, float)
        self.q = self.G @ self.positions + self.g0
        pin.framesForwardKinematics(self.model, self.data, self.q)

    def com_point(self, reference: str) -> Array:
        """Centre of mass (3,) [m], the root's mass included."""
        built, root = self._built, self._built.root_mass / self._built.total_mass
        own = pin.centerOfMass(self.model, self.data, self.q, False)
        seen_from = self.data.oMf[built.frame_id(reference)]
        found = (1.0 - root) * own + root * built.root_com - seen_from.translation
        return np.asarray(seen_from.rotation.T @ found, float)

    def pose(self, frame: str, reference: str) -> tuple[Array, Array]:
        """Origin p (3,) [m] and axes R (3, 3) of a frame."""
        seen, seen_from = (self.data.oMf[self._built.frame_id(name)] for name in (frame, reference))
        axes = seen_from.rotation.T
        return axes @ (seen.translation - seen_from.translation), axes @ seen.rotation

    def com(self, reference: str) -> tuple[Array, Array]:
        """Centre of mass (3,) [m] and its Jacobian (3, n) [m/rad], the root's mass included."""
        built, root = self._built, self._built.root_mass
        J = pin.jacobianCenterOfMass(self.model, self.data, self.q)
        share = 1.0 - root / built.total_mass
        point = share * self.data.com[0] + root / built.total_mass * built.root_com
        return self._seen(point, share * J, reference)

    def frame(self, frame: str, reference: str) -> tuple[Array, Array, Array]:
        """Origin p (3,) [m], axes R (3, 3) and Jacobian (6, n): dp/dt over ω."""
        placement, J = self._moving(frame)
        seen_from, J_reference = self._moving(reference)
        p, J_p = self._seen(placement.translation, J[:3], reference)
        axes = seen_from.rotation.T
        turning = axes @ (J[3:] - J_reference[3:]) @ self.G
        return p, axes @ placement.rotation, np.vstack([J_p, turning])

    def in_root(self, frame: str) -> tuple[Array, Array, Array]:
        """Origin (3,) [m], axes (3, 3) and Jacobian (6, n) of a frame, in the root's axes."""
        placement, J = self._moving(frame)
        return placement.translation.copy(), placement.rotation.copy(), J @ self.G

    def move(self, dq: Array) -> None:
        """Take joint velocities as well, (n,) [rad/s or m/s], after `place`: for what drifts."""
        self._v = self.G @ dq
        still = np.zeros_like(self._v)
        pin.forwardKinematics(self.model, self.data, self.q, self._v, still)
        pin.centerOfMass(self.model, self.data, self.q, self._v, still, False)
        pin.updateFramePlacements(self.model, self.data)

    def com_drift(self, reference: str) -> Array:
        """J̇·dq (3,) [m/s²] of the centre of mass as seen from a frame, J as of `com`."""
        built = self._built
        root = built.root_mass / built.total_mass
        place = (1.0 - root) * self.data.com[0] + root * built.root_com
        velocity, drift = (1.0 - root) * self.data.vcom[0], (1.0 - root) * self.data.acom[0]
        return self._relative(place, velocity, drift, reference)

    def frame_drift(self, frame: str, reference: str) -> Array:
        """J̇·dq (6,) of a frame as seen from another, J as of `frame`: d²p/dt² over dω/dt."""
        place, velocity, drift = self._motion(frame)
        _, carried, bent = self._motion(reference)
        axes = self.data.oMf[self._built.frame_id(reference)].rotation.T
        point = self._relative(place, velocity[:3], drift[:3], reference)
        spin = velocity[3:] - carried[3:]
        turning = drift[3:] - bent[3:] - np.cross(carried[3:], spin)
        return np.concatenate([point, axes @ turning])

    def move_apart(self, frame: str, reference: str, dq: Array) -> None:
        """Take velocities, (n,), of those joints alone that move one of two frames."""
        chain = [
            set(self.model.supports[self.model.frames[self._built.frame_id(name)].parentJoint])
            for name in (frame, reference)
        ]
        v, self._v = self.G @ dq, np.zeros_like(self._v)
        for joint in chain[0] ^ chain[1]:
            self._v[self.model.joints[joint].idx_v] = v[self.model.joints[joint].idx_v]
        pin.forwardKinematics(self.model, self.data, self.q, self._v, np.zeros_like(v))

    def point_drift(self, frame: str, point: Array) -> Array:
        """Acceleration (3,) of a point (3,) of the root's axes that is fixed to a frame."""
        place, twist, drift = self._motion(frame)
        arm, omega = point - place, twist[3:]
        return np.asarray(
            drift[:3] + np.cross(drift[3:], arm) + np.cross(omega, np.cross(omega, arm)), float
        )

    def frame_motion(self, frame: str, *, own_axes: bool) -> tuple[Array, Array, Array]:
        """J (6, n), ν = J·dq and J̇·dq of a frame against the root, after `move`.

        In the frame's own axes, where J̇·dq is the rate of the twist ν in them; or in the root's,
        where it is what the frame's origin accelerates by.
        """
        number = self._built.frame_id(frame)
        axes = pin.LOCAL if own_axes else pin.LOCAL_WORLD_ALIGNED
        accelerate = pin.getFrameAcceleration if own_axes else pin.getFrameClassicalAcceleration
        J = pin.getFrameJacobian(self.model, self.data, number, axes) @ self.G
        twist = pin.getFrameVelocity(self.model, self.data, number, axes).vector
        return J, twist, accelerate(self.model, self.data, number, axes).vector

    def _motion(self, frame: str) -> tuple[Array, Array, Array]:
        """Origin (3,), twist (6,) and its rate (6,) of a frame, in the root's axes."""
        _, twist, drift = self.frame_motion(frame, own_axes=False)
        return self.data.oMf[self._built.frame_id(frame)].translation, twist, drift

    def _relative(self, point: Array, velocity: Array, drift: Array, reference: str) -> Array:
        """Acceleration (3,) of a point as seen from a frame that turns and accelerates itself."""
        origin, twist, bent = self._motion(reference)
        arm, omega = point - origin, twist[3:]
        carried = np.cross(omega, arm)
        seen = velocity - twist[:3] - carried
        found = drift - bent[:3] - np.cross(bent[3:], arm) - np.cross(omega, carried)
        axes = self.data.oMf[self._built.frame_id(reference)].rotation.T
        return np.asarray(axes @ (found - 2.0 * np.cross(omega, seen)), float)

    def _seen(self, point: Array, J: Array, reference: str) -> tuple[Array, Array]:
        """A point of the root's axes and its Jacobian as seen from a frame that moves itself."""
        placement, carried = self._moving(reference)
        arm = point - placement.translation
        with_it = carried[:3] - pin.skew(arm) @ carried[3:]
        axes = placement.rotation.T
        return axes @ arm, axes @ (J - with_it) @ self.G

    def _moving(self, frame: str) -> tuple[pin.SE3, Array]:
        """Placement of a frame, and the Jacobian of its origin in the root's axes, (6, nv)."""
        number = self._built.frame_id(frame)
        J = pin.getFrameJacobian(self.model, self.data, number, pin.LOCAL_WORLD_ALIGNED)
        return self.data.oMf[number], J


class RigidBody:
    """M and h of M·q̈ + h = τ, and what gravity takes, all in wire order.

    Args:
        robot: whose model is used; its data stay as they are.

    Attributes:
        damping: viscous friction of the URDF, (n,) [N m s/rad or N s/m]; of mimic joints, what
            their mimicked joints feel of it.
    """

    def __init__(self, robot: Robot) -> None:
        self._model, self._G, self._g0 = robot.model.copy(), robot.G, robot.g0
        if robot.description.gravity == "none":
            self._model.gravity.setZero()
        self._adds_gravity = robot.description.gravity == "compensated"
        self._data = self._model.createData()
        self.damping = (self._G**2).T @ self._model.damping  # d·dq², mimic joints': d·r²·dq²

    def at(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """M (n, n), h (n,), and the torques that the robot itself adds to commands, (n,)."""
        model, data, G = self._model, self._data, self._G
        full = G @ q + self._g0
        M = np.triu(pin.crba(model, data, full))
        M = G.T @ (M + np.triu(M, 1).T) @ G
        h = G.T @ pin.nonLinearEffects(model, data, full, G @ dq)
        if not self._adds_gravity:
            return M, h, np.zeros(len(q))
        return M, h, G.T @ pin.computeGeneralizedGravity(model, data, full)


def mimic_matrix(description: RobotDescription, model: pin.Model) -> tuple[Array, Array]:
    """G and g₀ of q_pinocchio = G·q + g₀.

    A joint of the wire has a single 1 in its row. The row of one that follows is its mimicked
    joint's, times the multiplier of its <mimic>, and so is its g₀, to which the offset is added.

    Args:
        description: of the robot.
        model: with one coordinate for each moving joint.

    Returns:
        (m, n) and (m,) [rad or m], in Pinocchio's order.
    """
    mimics = {
        joint.attrib["name"]: mimic.attrib
        for joint in ET.fromstring(description.urdf).iterfind("joint")  # noqa: S314 (read before)
        if (mimic := joint.find("mimic")) is not None
    }
    G, g0 = np.zeros((model.nv, description.n)), np.zeros(model.nv)
    for joint in range(1, model.njoints):
        row = model.joints[joint].idx_v
        G[row], g0[row] = _law(model.names[joint], mimics, description.joint_names)
    return G, g0


def _law(
    name: str, mimics: Mapping[str, Mapping[str, str]], wire: tuple[str, ...]
) -> tuple[Array, float]:
    if name not in mimics:
        return np.array([float(other == name) for other in wire]), 0.0
    mimic = mimics[name]
    ratio = float(mimic.get("multiplier", "1"))
    row, offset = _law(mimic["joint"], mimics, wire)
    return ratio * row, ratio * offset + float(mimic.get("offset", "0"))
