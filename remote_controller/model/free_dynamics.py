"""Dynamics of a robot whose root link is free to move, and motion of its frames and its CoM."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model, one_coordinate_each
from hoap3.remote_controller.model.frame_dynamics import POSITION, FrameRows

BASE = 6
"""Coordinates of the base, before the joints."""
POSE_OF_BASE, STATE_OF_BASE = 7, 13
COM_FRAME = -1
FREE_BASE = "free base"  # no joint of a robot has a blank in its name


class FreeDynamics:
    """M(q)·v̇ + h(q, v) = (0, τ) + Σ Jᵀw of a robot, and d/dt ν = J·v̇ + J̇·v of its frames.

    v, (n + 6,), is the twist of the root link in its own axes, velocity of its origin [m/s] over
    angular velocity [rad/s], and then the joints' velocities in wire order. All else is in the
    world, z up. Gravity is part of h, friction is not. As `FramesDynamics`, whose attributes mean
    the same where they have the same name. Of a robot with mimic joints M, h and J come from those
    of all m joints, as `protocol.robot.mimic_joints` says; the base is its own mimicked joint.

    Args:
        description: of the robot.
        frames: which, and where their rows stand. `COM` is the centre of mass, of `POSITION` rows.
        rows: of the whole stack, m; those of no frame are 0 at first.

    Attributes:
        base: State.base, (13,), to be written to before `update`: position [m], quaternion x y z w,
            velocity [m/s] and angular velocity [rad/s] of the root link in the world's axes.
        velocity: v of the last `update`, (n + 6,).
        mass, bias: M (n + 6, n + 6) and h (n + 6,).
        jacobian, drift, twist: J (m, n + 6), J̇·v (m,) and ν (m,); `POSITION` rows are the velocity
            of an origin in the world's axes, `POSE` rows a twist in the frame's own.
        origins, rotations: of the frames in the world, (k, 3) [m] and (k, 3, 3).
        com, com_velocity: (3,) [m], [m/s].
        total_mass: [kg].
        damping: viscous friction of the joints, (n,) [N m s/rad].
        weight: 0, (n,): no robot with a free base adds what holds it.

    Raises:
        DescriptionError: Pinocchio cannot build the model, or the robot's gravity is `compensated`.
        FrameNotFoundError: the robot has no such frame.
    """

    def __init__(
        self, description: RobotDescription, frames: Sequence[FrameRows], rows: int
    ) -> None:
        import pinocchio as pin

        if description.gravity == "compensated":
            raise DescriptionError(
                f"robot {description.name!r} adds what holds it against gravity, which nobody "
                "knows of a free base. Set plant.gravity to full"
            )
        fixed = build_model(description)  # which says what is wrong with the URDF
        self._pin, self._robot, n = pin, fixed, description.n
        urdf = one_coordinate_each(description)
        self._model = model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer(), FREE_BASE)
        self._mimic_joints, names = fixed.mimic_joints, list(description.joint_names)
        if fixed.mimic_joints is not None:
            names += fixed.mimic_joints.names
        order = [model.joints[model.getJointId(name)].idx_v for name in names]
        self._order = np.array([*range(BASE), *order], np.intp)
        model.armature[self._order[BASE : BASE + n]] = description.armature
        self._to_wire: FloatArray | None = None  # of twists of base and all joints
        if fixed.mimic_joints is not None:
            self._to_wire = np.eye(len(self._order), BASE + n)
            self._to_wire[BASE:, BASE:] = fixed.mimic_joints.matrix
        if description.gravity == "none":
            model.gravity.setZero()
        self._data = model.createData()
        self.n, self.total_mass = n, fixed.total_mass
        self.damping = np.array(model.damping)[order]
        if fixed.mimic_joints is not None:
            self.damping = fixed.mimic_joints.resistance(self.damping, dry=False)
        self._numbers = {
            name: int(model.getFrameId(name, pin.FrameType.BODY)) for name in description.frames
        }
        self._frames = [
            (place, COM_FRAME if each.frame == COM else self._number(each.frame), each)
            for place, each in enumerate(frames)
        ]
        self._q, self._v, self._still = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        self.base, self.velocity = np.zeros(STATE_OF_BASE), np.zeros(n + BASE)
        self.base[POSE_OF_BASE - 1] = 1.0
        self.mass, self.bias = np.zeros((n + BASE, n + BASE)), np.zeros(n + BASE)
        self.weight = np.zeros(n)
        self.jacobian = np.zeros((rows, n + BASE))
        self.twist, self.drift = np.zeros(rows), np.zeros(rows)
        self.origins, self.rotations = np.zeros((len(frames), 3)), np.zeros((len(frames), 3, 3))
        self.com, self.com_velocity = np.zeros(3), np.zeros(3)

    def update(self, q: FloatArray, dq: FloatArray) -> None:
        """Take joint positions and velocities, (n,), and `base`; all finite."""
        pin, model, data, order = self._pin, self._model, self._data, self._order
        self._set(q)
        turn = pin.Quaternion(self._q[3:7]).matrix()
        np.matmul(turn.T, self.base[7:10], out=self.velocity[:3])
        np.matmul(turn.T, self.base[10:13], out=self.velocity[3:BASE])
        self.velocity[BASE:] = dq
        self._v[order] = self._full(self.velocity)
        upper = np.triu(pin.crba(model, data, self._q))
        upper += np.triu(upper, 1).T
        self.mass[:] = self._wire(self._wire(upper[np.ix_(order, order)]).T)
        self.bias[:] = self._wire(pin.nonLinearEffects(model, data, self._q, self._v)[order])
        com_jacobian = self._wire(pin.jacobianCenterOfMass(model, data, self._q, False)[:, order])
        pin.centerOfMass(model, data, self._q, self._v, self._still, False)
        pin.computeJointJacobians(model, data)
        pin.updateFramePlacements(model, data)
        self.com[:], self.com_velocity[:] = data.com[0], data.vcom[0]
        for place, number, (_, start, size, turns) in self._frames:
            rows = slice(start, start + size)
            if number == COM_FRAME:
                self.jacobian[rows], self.drift[rows] = com_jacobian, data.acom[0]
                self.origins[place], self.twist[rows] = self.com, self.com_velocity
                continue
            axes = pin.LOCAL_WORLD_ALIGNED if size == POSITION else pin.LOCAL
            part = slice(POSITION, None) if turns else slice(size)
            jacobian = self._wire(pin.getFrameJacobian(model, data, number, axes)[part, order])
            self.jacobian[rows] = jacobian
            np.matmul(jacobian, self.velocity, out=self.twist[rows])
            if size == POSITION:
                rate = pin.getFrameClassicalAcceleration(model, data, number, axes)
            else:
                rate = pin.getFrameAcceleration(model, data, number, axes)
            self.drift[rows] = rate.vector[part]
            self._write(number, self.origins[place], self.rotations[place])

    def placement(self, q: FloatArray, frame: str) -> tuple[FloatArray, FloatArray]:
        """Where a frame is with joints at `q`, (n,), and `base`: origin (3,) [m], axes (3, 3).

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        self._set(q)
        self._pin.framesForwardKinematics(self._model, self._data, self._q)
        origin, axes = np.zeros(3), np.zeros((3, 3))
        self._write(self._number(frame), origin, axes)
        return origin, axes

    def _set(self, q: FloatArray) -> None:
        """Take posture and base; the quaternion's length may be off by rounding."""
        self._q[:POSE_OF_BASE] = self.base[:POSE_OF_BASE]
        self._q[3:POSE_OF_BASE] /= np.linalg.norm(self._q[3:POSE_OF_BASE])
        full = q if self._mimic_joints is None else self._mimic_joints.positions(q)
        self._q[self._order[BASE:] + 1] = full

    def _full(self, velocity: FloatArray) -> FloatArray:
        """Of base and all joints, from those of base and wire, (n + 6,)."""
        return velocity if self._to_wire is None else self._to_wire @ velocity

    def _wire(self, full: FloatArray) -> FloatArray:
        """J_m·G, or Gᵀ·τ_m: (…, m + 6) to (…, n + 6)."""
        return full if self._to_wire is None else np.asarray(full @ self._to_wire)

    def _write(self, number: int, origin_out: FloatArray, axes_out: FloatArray) -> None:
        found = self._data.oMf[number]
        origin_out[:], axes_out[:] = found.translation, found.rotation

    def _number(self, frame: str) -> int:
        self._robot.frame_id(frame)  # or says that there is none
        return self._numbers[frame]
