"""Where the points of a robot are, and how they move, by Pinocchio's own functions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model

Array = NDArray[np.float64]


class Robot:
    """A robot at one joint position; all results are in wire order, in a reference frame's axes.

    Args:
        description: of the robot.

    Attributes:
        model, data: Pinocchio's.
        order: (n,) place of each joint of the wire in Pinocchio's q and v.
    """

    def __init__(self, description: RobotDescription) -> None:
        self._built = build_model(description)
        self.model, self.data, self.order = self._built.model, self._built.data, self._built.order
        self.q = np.zeros(self.model.nq)

    def place(self, q: Array) -> None:
        """Take joint positions, (n,) [rad or m]."""
        self.q[self.order] = q
        pin.computeJointJacobians(self.model, self.data, self.q)
        pin.updateFramePlacements(self.model, self.data)

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
        turning = axes @ (J[3:] - J_reference[3:])[:, self.order]
        return p, axes @ placement.rotation, np.vstack([J_p, turning])

    def _seen(self, point: Array, J: Array, reference: str) -> tuple[Array, Array]:
        """A point of the root's axes and its Jacobian as seen from a frame that moves itself."""
        placement, carried = self._moving(reference)
        arm = point - placement.translation
        with_it = carried[:3] - pin.skew(arm) @ carried[3:]
        axes = placement.rotation.T
        return axes @ arm, (axes @ (J - with_it))[:, self.order]

    def _moving(self, frame: str) -> tuple[pin.SE3, Array]:
        """Placement of a frame, and the Jacobian of its origin in the root's axes, (6, nv)."""
        number = self._built.frame_id(frame)
        J = pin.getFrameJacobian(self.model, self.data, number, pin.LOCAL_WORLD_ALIGNED)
        return self.data.oMf[number], J
