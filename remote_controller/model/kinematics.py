"""Kinematics, once per sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model


@dataclass(frozen=True)
class _Frame:
    """What is needed of a frame: views of its placement, and the joints that move it."""

    origin: FloatArray
    rotation: FloatArray
    moved_by: NDArray[np.bool_]


class Kinematics:
    """Where the robot's frames and its centre of mass are, and how they move with the joints.

    Joints are in wire order, everywhere, and mimic joints move with them (`MimicJoints`); "full"
    are all m joints, those of the wire and behind them the mimic joints. The root link is
    Pinocchio's fixed base; its mass is kept in the centre of mass.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(self, description: RobotDescription) -> None:
        import pinocchio

        from hoap3.remote_controller.model.kinematics_kernels import com_in_frame, frame_in_frame

        self._com_in_frame, self._frame_in_frame = com_in_frame, frame_in_frame
        self.robot = build_model(description)
        self.n, self.mimic_joints = description.n, self.robot.mimic_joints
        self._model, self._data = self.robot.model, self.robot.data
        self._order = np.array(self.robot.order, np.int64)
        self._wire, m = self._order[: self.n], len(self._order)
        self._full = {rows: np.zeros((rows, m)) for rows in (3, 6)}  # Jacobians of all m joints
        self._q, self._v, self._still = np.zeros((3, m))
        root_share = self.robot.root_mass / (self.robot.total_mass or 1.0)
        self._moving_share = 1.0 - root_share
        root_com: Any = self.robot.root_com
        self._root_moment = np.array(root_com * root_share)
        self._check_mass = None if description.structure.weighs else description.check_mass
        self._pass = pinocchio.jacobianCenterOfMass
        self._accelerate = pinocchio.centerOfMass
        self._place = pinocchio.updateFramePlacement
        # Pinocchio hands out views, which every pass rewrites; a single column comes as a vector
        self._com = self._data.com[0]
        self._com_jacobian = self._data.Jcom.reshape(3, m)
        self._joint_jacobian = self._data.J.reshape(6, m)
        self._frames: dict[int, _Frame] = {}
        self._place_all = pinocchio.updateFramePlacements
        placements = self._data.oMf
        self._drift: Any = None
        self._all_frames = (
            stacked([placement.translation for placement in placements]),
            stacked([placement.rotation for placement in placements]),
            self._joint_jacobian,
            self._order,
        )

    def frame_id(self, frame: str) -> int:
        """Number of a frame.

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        number = int(self.robot.frame_id(frame))
        if number not in self._frames:
            placement, moved_by = self._data.oMf[number], self.robot.moved_by(frame)
            self._frames[number] = _Frame(placement.translation, placement.rotation, moved_by)
        return number

    def update(self, q: FloatArray) -> None:
        """Take the joint positions `q`, (n,) [rad or m]."""
        self._q[self._order] = q if self.mimic_joints is None else self.mimic_joints.positions(q)
        self._pass(self._model, self._data, self._q, False)

    def joints(self, position_out: FloatArray) -> None:
        """Write the joint positions that `update` took, (n,) [rad or m]."""
        np.take(self._q, self._wire, out=position_out)

    def com(self, frame: int, position_out: FloatArray, jacobian_out: FloatArray) -> None:
        """Centre of mass, (3,) [m], and its Jacobian, (3, n) [m/rad], as seen from a frame.

        Args:
            frame: what `frame_id` gave.
            position_out, jacobian_out: written.

        Raises:
            DescriptionError: nothing that moves has a mass.
        """
        if self._check_mass is not None:
            self._check_mass()
        self._place(self._model, self._data, frame)
        seen_from = self._frames[frame]
        self._com_in_frame(
            self._com_jacobian,
            self._joint_jacobian,
            self._com,
            seen_from.origin,
            seen_from.rotation,
            seen_from.moved_by,
            self._root_moment,
            self._moving_share,
            self._order,
            position_out,
            jacobian_out if self.mimic_joints is None else self._full[3],
        )
        if self.mimic_joints is not None:
            self.mimic_joints.columns(self._full[3], jacobian_out)

    def frame(
        self,
        frame: int,
        reference: int,
        position_out: FloatArray,
        rotation_out: FloatArray,
        jacobian_out: FloatArray,
    ) -> None:
        """Where a frame is, as seen from another, and how it moves with the joints.

        The first three rows of the Jacobian are the velocity of the frame's origin relative to
        the reference, dp/dq [m/rad], and the last three the relative angular velocity ω, both in
        the reference's axes: dR/dt = ω × R.

        Args:
            frame, reference: what `frame_id` gave.
            position_out: written, p, (3,) [m].
            rotation_out: written, R, (3, 3); its columns are the frame's axes.
            jacobian_out: written, (6, n).
        """
        self._place(self._model, self._data, frame)
        self._place(self._model, self._data, reference)
        seen, seen_from = self._frames[frame], self._frames[reference]
        self._frame_in_frame(
            self._joint_jacobian,
            seen.origin,
            seen.rotation,
            seen.moved_by,
            seen_from.origin,
            seen_from.rotation,
            seen_from.moved_by,
            self._order,
            position_out,
            rotation_out,
            jacobian_out if self.mimic_joints is None else self._full[6],
        )
        if self.mimic_joints is not None:
            self.mimic_joints.columns(self._full[6], jacobian_out)

    def load_drift(self) -> None:
        """Have `frame_drift` and `com_drift` ready, which controllers of velocities never ask."""
        from hoap3.remote_controller.model import drift_kernels

        self._drift = drift_kernels

    def frame_drift(self, frame: int, reference: int, dq: FloatArray, out: FloatArray) -> None:
        """Write J̇·dq, with J as of `frame`: what the frame accelerates by where no joint does.

        After `load_drift`, once.

        Args:
            frame, reference: what `frame_id` gave.
            dq: (n,) [rad/s or m/s].
            out: (6,) d²p/dt² [m/s²] over dω/dt [rad/s²], in the reference's axes.
        """
        self._place(self._model, self._data, frame)
        self._place(self._model, self._data, reference)
        seen, seen_from = self._frames[frame], self._frames[reference]
        self._move(dq)
        self._drift.frame_drift(
            self._joint_jacobian,
            self._v,
            seen.origin,
            seen.moved_by,
            seen_from.rotation,
            seen_from.moved_by,
            out,
        )

    def _move(self, dq: FloatArray) -> None:
        self._v[self._order] = dq if self.mimic_joints is None else self.mimic_joints.velocities(dq)

    def com_drift(self, frame: int, dq: FloatArray, out: FloatArray) -> None:
        """Write J̇·dq of the centre of mass, with J as of `com`, (3,) [m/s²]; after `load_drift`.

        Args:
            frame: what `frame_id` gave.
            dq: (n,) [rad/s or m/s].
            out: written, in the frame's axes.
        """
        share, data, seen_from = self._moving_share, self._data, self._frames[frame]
        self._move(dq)
        self._accelerate(self._model, data, self._q, self._v, self._still, False)
        self._place(self._model, data, frame)
        self._drift.com_drift(
            self._joint_jacobian,
            self._v,
            share * self._com + self._root_moment,
            share * data.vcom[0],
            share * data.acom[0],
            seen_from.rotation,
            seen_from.moved_by,
            out,
        )

    def frames(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]]:
        """All frames at once, for kernels: views that the next `update` makes stale.

        Returns:
            Origins (F, 3) [m] and rotations (F, 3, 3) by `frame_id`; the twist that each joint
            gives what it carries, (6, m): velocity of the point at the root's origin over angular
            velocity, all in the root's axes and Pinocchio's order; and the full joints' columns
            in it, (m,).
        """
        self._place_all(self._model, self._data)
        return self._all_frames

    def moved_by(self, frame: int) -> NDArray[np.bool_]:
        """Whether each of the full joints moves a frame, (m,)."""
        return self._frames[frame].moved_by[self._order]


def stacked(arrays: Sequence[FloatArray]) -> FloatArray:
    """One view of arrays of the same layout that lie in memory at equal distances.

    Raises:
        ValueError: they do not.
    """
    first = arrays[0]
    addresses = np.array([array.ctypes.data for array in arrays])
    steps = np.diff(addresses)
    apart = int(steps[0]) if len(steps) else 0
    if np.any(steps != apart) or any(array.strides != first.strides for array in arrays):
        raise ValueError("the arrays do not lie at equal distances")
    return np.lib.stride_tricks.as_strided(
        first, (len(arrays), *first.shape), (apart, *first.strides)
    )
