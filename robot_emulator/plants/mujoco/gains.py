"""Gains of the position servos, and how fast a loop around them may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.model import MujocoModel, build_model
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters


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
    """M of the joints of the wire and their mimic joints, Gᵀ·M·G, (n, n)."""
    mujoco.mj_forward(built.model, data)
    whole = np.zeros((built.model.nv, built.model.nv))
    mujoco.mj_fullM(built.model, data, whole)
    return np.asarray(built.ties.matrix.T @ whole @ built.ties.matrix)


CLOSE = 1e-3  # relative: how near the limit comes to that of the proof, from below
NEARLY = 1e-3  # of its size: real part of a root that is looked at as if it were imaginary


def rate_limit(mass: FloatArray, kp: FloatArray, kv: FloatArray) -> float:
    """A rate below which every loop u = −B·(q − q_d), B symmetric, λ(B) ≥ 0, is stable [1/s].

    The loop is M·q̈ + K_v·q̇ + K_p·q = K_p·q*, q̇* = u. For K_p alike in all joints the limit is
    1/λ_max(K_v^(−1/2)·M·K_v^(−1/2)), by Routh's criterion; otherwise, for any η ≥ 0,

        1 / sup over ω of λ_max(He R(iω)),    R(s) = (M·s² + K_v·s + K_p)⁻¹·(M·s + K_v − η·K_p)

    with He R = (R + R*)/2. The greater limit for η the least and the greatest kv/kp is taken.

    Args:
        mass: M, (n, n), symmetric [kg m², or as the joints have it].
        kp: of each joint, (n,), above 0 [N m/rad or N/m].
        kv: the same of their damping [N m s/rad or N s/m].
    """
    if kp.min() == kp.max():
        damped = np.sqrt(kv)
        return 1.0 / float(np.linalg.eigvalsh(mass / np.outer(damped, damped))[-1])
    ratios = kv / kp
    return max(1.0 / _greatest(mass, kp, kv, eta) for eta in {ratios.min(), ratios.max()})


def _greatest(mass: FloatArray, kp: FloatArray, kv: FloatArray, eta: float) -> float:
    """Sup over ω of λ_max(He R(iω)), from above.

    2g·1 − R(s) − R(−s)ᵀ is singular where λ_max reaches g, and then iω is an eigenvalue of a
    matrix: where there is none, g is above all; else the greatest value between two of them is a
    better g (after Bruinsma and Steinbuch, Systems & Control Letters 14, 1990).
    """
    n = len(kp)
    inverse, one = np.linalg.inv(mass), np.eye(n)
    A = np.block([[np.zeros((n, n)), one], [-inverse * kp, -inverse * kv]])
    B, C = np.vstack([one, -eta * inverse * kp]), np.hstack([one, np.zeros((n, n))])

    def largest(omegas: FloatArray) -> float:
        s = 1j * omegas[:, None, None]
        R = np.linalg.solve(s * s * mass + s * np.diag(kv) + np.diag(kp),
                            s * mass + np.diag(kv - eta * kp))  # fmt: skip
        return float(np.linalg.eigvalsh(0.5 * (R + R.conj().swapaxes(1, 2)))[:, -1].max())

    found = largest(np.append(0.0, np.abs(np.linalg.eigvals(A))))
    while True:
        g = (1.0 + CLOSE) * found
        crossing = np.block([[A, np.zeros_like(A)], [np.zeros_like(A), -A.T]])
        crossing += np.vstack([B, -C.T]) @ np.hstack([C, B.T]) / (2.0 * g)
        roots = np.linalg.eigvals(crossing)
        omegas = np.sort(np.abs(roots.imag[np.abs(roots.real) <= NEARLY * np.abs(roots)]))
        found = largest(np.concatenate([[0.0], omegas, 0.5 * (omegas[1:] + omegas[:-1])]))
        if found <= g:
            return g
