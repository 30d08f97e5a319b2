"""Algorithm 4 on a robot with followers, by Pinocchio: what `torque_bounds_kernels` does, slower.

The tables of the kernels know each moving joint for itself. With followers joint j of the wire has
M_jj = g_jᵀ·M_m·g_j and h_j = g_jᵀ·h_m, g_j its column of G (`followers`), so M is needed whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.pinocchio_model import RobotModel
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.protocol.robot.torque_bounds_kernels import FINEST, NO_INERTIA, NOT_FINITE, OK, SWEEPS


class FollowerStates:
    """States of a robot with followers, in wire order.

    Args:
        robot: of which gravity, inertias and armature are taken.

    Attributes:
        order: (n,) place of each joint of the wire in the arrays here: its own.
    """

    def __init__(self, robot: RobotModel) -> None:
        n = robot.description.n
        self._dynamics = Dynamics(robot.description, robot)
        self.order: NDArray[np.int64] = np.arange(n)
        self._bias = np.zeros(n)

    def sample(
        self,
        limits: FloatArray,
        at_corners: bool,
        drawn: FloatArray,
        bounds: FloatArray,
        states: FloatArray,
    ) -> tuple[int, int]:
        """As `torque_bounds_kernels.sample`."""
        least, greatest, speed, most = limits
        n = len(least)
        for row in drawn:
            q, share = least + row[:n] * (greatest - least), row[n:]
            dq = np.where(share >= 0.5, speed, -speed) if at_corners else (2 * share - 1) * speed
            bias, inertia = self._at(q, dq)
            for status, wrong in (
                (NOT_FINITE, ~(np.isfinite(bias) & np.isfinite(inertia))),
                (NO_INERTIA, ~(inertia > 0.0)),
            ):
                if wrong.any():
                    return status, int(np.argmax(wrong))
            lower, upper = (-most - bias) / inertia, (most - bias) / inertia
            for side, tighter in enumerate((lower > bounds[0], upper < bounds[1])):
                bounds[side, tighter] = (lower, upper)[side][tighter]
                states[side, tighter] = q, dq
        return OK, -1

    def polish(
        self, limits: FloatArray, joint: int, upwards: bool, q: FloatArray, dq: FloatArray
    ) -> float:
        """As `torque_bounds_kernels.polish`."""
        least, greatest, speed, _ = limits
        sign, most = (1.0 if upwards else -1.0), limits[3, joint]

        def tried(array: FloatArray, i: int, value: float) -> float:
            array[i] = value
            bias, inertia = self._at(q, dq)
            return float((sign * bias[joint] - most) / inertia[joint])

        worst, step = tried(q, 0, q[0]), 0.25  # the bound times −sign; of each position's range
        for _ in range(SWEEPS):
            before = worst
            for i in range(len(q)):
                best, ends = dq[i], [-speed[i], 0.0, speed[i]]
                down, still, up = found = [tried(dq, i, end) for end in ends]
                curved, back = down - 2.0 * still + up, 0.5 * (down - up)
                if curved < 0.0 and abs(back) < -curved:
                    ends.append(speed[i] * back / curved)
                    found.append(tried(dq, i, ends[-1]))
                if max(found) > worst:
                    worst, best = max(found), ends[int(np.argmax(found))]
                dq[i], best = best, q[i]
                far = step * (greatest[i] - least[i])
                for place in np.clip((best - far, best + far), least[i], greatest[i]):
                    here = tried(q, i, place)
                    if here > worst:
                        worst, best = here, place
                q[i] = best
            if not worst > before:
                step *= 0.5
                if step < FINEST:
                    break
        return float(-sign * worst)

    def _at(self, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bias h, (n,), and the diagonal of M, (n,)."""
        self._dynamics.bias(q, dq, self._bias)
        return self._bias, self._dynamics.mass(q).diagonal()
