"""Gains of the position servos, and how fast a loop around them may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.plants.mujoco.model import MujocoModel, build_model
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters
from hoap3.robot_emulator.plants.servo_loop import rate_limit


@dataclass(frozen=True)
class Gains:
    """Position servos, τ = kp·(q* − q) − kv·dq.

    Attributes:
        kp: (n,) [N m/rad or N/m].
        kv: (n,) [N m s/rad or N s/m].
        rate_limit: that of `servo_loop`, for M of the start posture [1/s].
    """

    kp: FloatArray
    kv: FloatArray
    rate_limit: float


def servo_gains(
    mujoco: Any,
    built: MujocoModel,
    data: Any,
    parameters: MujocoParameters,
    description: RobotDescription,
) -> Gains:
    """The gains that the settings give, or else ω²·I and 2ω·I with I the inertia that moves.

    Args:
        mujoco, built, data: module, model and its `MjData`, at the start posture.
        parameters, description: of the robot.
    """
    soles = [int(built.model.site_bodyid[built.site(sole.frame)]) for sole in description.soles]
    moved = _moved(mujoco, built, data, soles)
    omega = parameters.servo_rad_s
    kp, kv = omega * omega * moved, 2.0 * omega * moved
    for place, joint in enumerate(description.joint_names):
        for gains, given in ((kp, parameters.kp), (kv, parameters.kv)):
            value = given.get(joint) if isinstance(given, dict) else given
            if value is not None:
                gains[place] = value
    mass = _mass_on_one_foot(mujoco, built, data, parameters, description)
    return Gains(kp, kv, rate_limit(mass, kp, kv))


def _moved(mujoco: Any, built: MujocoModel, data: Any, soles: list[int]) -> FloatArray:
    """Inertia that each joint moves, (n,): what is beyond it.

    Of a free base that is the greater side where a sole hangs from the joint, as it carries the
    rest; or of every joint where the robot has no soles.
    """
    model = built.model
    mass = _full(mujoco, built, data).diagonal().copy()
    if not built.free:
        return mass
    legs = set()
    for body in soles:
        carrier = body
        while carrier:
            legs.add(carrier)
            carrier = int(model.body_parentid[carrier])
    bodies = [b for b in range(1, model.nbody) if model.body_rootid[b] == built.root]
    for place, dof in enumerate(built.v_at):
        joint = int(model.dof_jntid[dof])
        if legs and int(model.jnt_bodyid[joint]) not in legs:
            continue
        axis, anchor = data.xaxis[joint], data.xanchor[joint]
        whole = 0.0
        for body in bodies:
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                whole += model.body_mass[body]
                continue
            arm = np.cross(axis, data.xipos[body] - anchor)
            along = data.ximat[body].reshape(3, 3).T @ axis
            whole += model.body_mass[body] * (arm @ arm) + along**2 @ model.body_inertia[body]
        rotor = float(model.dof_armature[dof])
        mass[place] = max(mass[place], whole - mass[place] + 2.0 * rotor)
    return mass


def _mass_on_one_foot(
    mujoco: Any,
    built: MujocoModel,
    data: Any,
    parameters: MujocoParameters,
    description: RobotDescription,
) -> FloatArray:
    """M of the joints with the base frame held, (n, n): the slowest that a body can be."""
    if not built.free or not built.urdf:
        return _full(mujoco, built, data)
    held = build_model(
        description, parameters.model_copy(update={"base": "fixed", "collide": "none"})
    )
    other = mujoco.MjData(held.model)
    held.pose(other, data.qpos[built.q_at])
    return _full(mujoco, held, other)


def _full(mujoco: Any, built: MujocoModel, data: Any) -> FloatArray:
    """M of the joints of the wire and their followers, Gᵀ·M·G, (n, n)."""
    mujoco.mj_forward(built.model, data)
    whole = np.zeros((built.model.nv, built.model.nv))
    mujoco.mj_fullM(built.model, data, whole)
    return np.asarray(built.ties.matrix.T @ whole @ built.ties.matrix)
