"""Dynamics of the robot and motion of some of its frames, once per sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics

POSITION, POSE = 3, 6


class FrameRows(NamedTuple):
    """Where in a stack of rows the motion of a frame stands.

    Attributes:
        frame: its name.
        start: the first of its rows.
        size: `POSITION`: velocity of its origin in the root's axes [m/s]; `POSE`: twist of the
            frame in its own axes (Pinocchio's LOCAL), velocity of its origin [m/s] over angular
            velocity [rad/s].
        turns: whether three rows are the angular velocity instead, in the world's axes; of
            `FreeDynamics` alone.
    """

    frame: str
    start: int
    size: int
    turns: bool = False


class FramesDynamics:
    """M(q)·ddq + h(q, dq) = τ of a robot, and d/dt ν = J·ddq + J̇·dq of the motion ν of its frames.

    Joints are in wire order. Gravity is part of h unless the description has it `none`; friction is
    not. However many frames: one crba, one nle and one kernel. Of a robot with mimic joints
    (`MimicJoints`) the kernel writes M, h and J of all m joints, "full", from which M, h and J
    come.

    Args:
        description: of the robot.
        frames: which, and where their rows stand; a frame may be named several times.
        rows: of the whole stack, m; those of no frame are nobody's here, and 0 at first.

    Attributes:
        mass, bias: M (n, n) and h (n,).
        weight: torques that hold the robot, (n,), where it adds these itself; else 0.
        jacobian, drift, twist: J (m, n), J̇·dq (m,) and ν (m,).
        origins, rotations: of the frames in the root's axes, (k, 3) [m] and (k, 3, 3).
        damping: viscous friction of the joints, (n,) [N m s/rad].

    Raises:
        DescriptionError: Pinocchio cannot build the model.
        FrameNotFoundError: the robot has no such frame.
    """

    def __init__(
        self, description: RobotDescription, frames: Sequence[FrameRows], rows: int
    ) -> None:
        import pinocchio

        from hoap3.remote_controller.model.frame_dynamics_kernels import frames_dynamics

        self._gather: Callable[..., None] = frames_dynamics
        rigid = Dynamics(description)  # which has set gravity
        self.n, self.damping, self._robot = description.n, rigid.damping, rigid.robot
        self._mimic_joints = rigid.mimic_joints
        self._rows = [slice(each.start, each.start + each.size) for each in frames]
        self._model, self._data = rigid.robot.model, rigid.robot.data
        self._order = np.array(rigid.robot.order, np.int64)
        self._crba, self._nle = pinocchio.crba, pinocchio.nonLinearEffects
        self._world = pinocchio.Convention.WORLD
        self._place_all = pinocchio.framesForwardKinematics
        self._weigh = pinocchio.computeGeneralizedGravity
        self._compensated = description.gravity == "compensated"
        carried = [rigid.carrier(each.frame) for each in frames]
        movers = [self._movers_of(each.frame) for each in frames]
        n, k, data, m = self.n, len(frames), self._data, len(self._order)
        self._q, self._v = np.zeros(m), np.zeros(m)
        self.mass, self.jacobian = np.zeros((n, n)), np.zeros((rows, n))
        self.bias, self.weight = np.zeros(n), np.zeros(n)
        self.twist, self.drift = np.zeros(rows), np.zeros(rows)
        self.origins, self.rotations = np.zeros((k, 3)), np.zeros((k, 3, 3))
        self._full = self.mass, self.bias, self.jacobian
        if self._mimic_joints is not None:
            self._full = np.zeros((m, m)), np.zeros(m), np.zeros((rows, m))
        self._rigid = (data.M.reshape(m, m), data.nle, data.J.reshape(6, m), _placements(data))
        self._layout: tuple[Any, ...] = (
            np.array([joint for joint, _ in carried], np.int64),
            np.array([mount for _, mount in carried]).reshape(k, 3, 4),
            self._order,
            np.concatenate([np.zeros(0, np.int64), *movers]),
            np.cumsum([0, *map(len, movers)]),
            np.array([[each.start, each.size] for each in frames], np.int64).reshape(k, 2),
        )
        self._out = *self._full, self.twist, self.drift, self.origins, self.rotations

    def update(self, q: FloatArray, dq: FloatArray) -> None:
        """Take joint positions and velocities, (n,) [rad, rad/s or m, m/s]; both finite."""
        model, data, order, mimic_joints = self._model, self._data, self._order, self._mimic_joints
        full = dq
        if mimic_joints is None:
            self._q[order], self._v[order] = q, dq
        else:
            full = mimic_joints.velocities(dq)
            self._q[order], self._v[order] = mimic_joints.positions(q), full
        self._crba(model, data, self._q, self._world)  # and the Jacobian of the joints
        self._nle(model, data, self._q, self._v)
        if self._compensated:
            weight = self._weigh(model, data, self._q)
            if mimic_joints is None:
                weight.take(order, out=self.weight, mode="clip")  # the other modes copy `out`
            else:
                mimic_joints.columns(weight[order], self.weight)
        self._gather(*self._rigid, *self._layout, full, *self._out)
        if mimic_joints is not None:
            mimic_joints.inertia(self._rigid[0], order, self.mass)
            mimic_joints.columns(self._full[1], self.bias)
            for mine in self._rows:
                mimic_joints.columns(self._full[2][mine], self.jacobian[mine])

    def placement(self, q: FloatArray, frame: str) -> tuple[FloatArray, FloatArray]:
        """Where a frame is in posture `q`, (n,): copies of origin (3,) [m] and rotation (3, 3)."""
        self._q[self._order] = q if self._mimic_joints is None else self._mimic_joints.positions(q)
        self._place_all(self._model, self._data, self._q)
        found = self._data.oMf[self._robot.frame_id(frame)]
        return found.translation.copy(), found.rotation.copy()

    def stands(self, frame: str) -> bool:
        """Whether no joint moves a frame."""
        return not self._robot.moved_by(frame).any()

    def _movers_of(self, frame: str) -> NDArray[np.int64]:
        """Of the full joints those that move a frame, from the root outwards."""
        return np.argsort(self._order)[self._robot.moved_by(frame)]


def _placements(data: Any) -> FloatArray:
    """View of where all joints are in the root, (joints, 12): R by columns, then the origin.

    Pinocchio keeps them one after the other, and gives away views of one at a time.
    """
    count, first = len(data.oMi), data.oMi[0].rotation.T
    return as_strided(first, (count, 12), (12 * first.itemsize, first.itemsize))
