"""Joints of a model that follow others: the equalities that MuJoCo makes of <mimic>, and others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray


@dataclass(frozen=True)
class Ties:
    """What all coordinates have to do with the n joints of the wire.

    Attributes:
        matrix: G, (nv, n): velocities are G·dq, of a base that stands still; forces count Gᵀ·f.
        mimic_joints: (f,) where each mimic joint is in qpos.
        mimicked, multipliers, offsets: (f,) it is at multiplier · that joint of the wire +
            offset.
    """

    matrix: FloatArray
    mimic_joints: NDArray[np.intp]
    mimicked: NDArray[np.intp]
    multipliers: FloatArray
    offsets: FloatArray


def ties_of(mujoco: Any, model: Any, joints: list[int]) -> Ties:
    """Those of a model.

    Args:
        mujoco, model: module and `mujoco.MjModel`.
        joints: MuJoCo's numbers of the joints of the wire, in its order.
    """
    led = _led(mujoco, model)
    matrix, found = np.zeros((model.nv, len(joints))), []
    for place, joint in enumerate(joints):
        matrix[model.jnt_dofadr[joint], place] = 1.0
    for mimic_joint in led.keys() - set(joints):
        joint, multiplier, offset, passed = mimic_joint, 1.0, 0.0, set[int]()
        while joint in led and joint not in {*joints, *passed}:
            passed.add(joint)
            joint, factor, shift = led[joint]
            multiplier, offset = multiplier * factor, offset + multiplier * shift
        if joint in joints:  # else it follows a joint without a motor
            matrix[model.jnt_dofadr[mimic_joint], joints.index(joint)] = multiplier
            found.append((model.jnt_qposadr[mimic_joint], joints.index(joint), multiplier, offset))
    table = np.array(sorted(found)).reshape(-1, 4)
    at, mimicked = table[:, :2].astype(np.intp).T
    return Ties(matrix, at, mimicked, table[:, 2], table[:, 3])


def _led(mujoco: Any, model: Any) -> dict[int, tuple[int, float, float]]:
    """By joint that follows another one in proportion: that one, multiplier and offset."""
    led = {}
    for number in range(model.neq):
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        offset, multiplier, *curved = map(float, model.eq_data[number][:5])
        joints = model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT and second >= 0
        if joints and model.eq_active0[number] and multiplier and not any(curved):
            q0, mimicked_q0 = (model.qpos0[model.jnt_qposadr[joint]] for joint in (first, second))
            led[first] = second, multiplier, float(q0 + offset - multiplier * mimicked_q0)
    return led
