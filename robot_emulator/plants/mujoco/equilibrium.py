"""Where a body in MuJoCo is at rest: the place of a free base, and the torques that hold it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.plants.mujoco.model import MujocoModel
from hoap3.robot_emulator.plants.mujoco.rerooted_urdf import rotation_of
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters

DEEP = 2e-4  # m: by which it is let into the floor before the search
BALANCED = 1e-9  # of its weight: forces and torques [N, N m per m of 1] that nothing holds
ROUNDS, HALVINGS = 60, 20
NUDGE = 1e-8  # m and rad
NUDGES: FloatArray = NUDGE * np.eye(3)


@dataclass(frozen=True)
class Start:
    """A start at rest.

    Attributes:
        torques: (n,) that the motors give [N m or N].
        unbalanced: force or torque on a free base that nothing holds, as a share of the weight.
    """

    torques: FloatArray
    unbalanced: float


def place(
    mujoco: Any,
    built: MujocoModel,
    data: Any,
    q: FloatArray,
    parameters: MujocoParameters,
    sole: str | None,
) -> Start:
    """Put the robot at rest at `q`, (n,); a free base stands so that nothing need hold it.

    Its height, and its tilt as far as contacts give way, solve mj_inverse's base rows = 0 at rest.

    Args:
        mujoco, built, data: module, model, and its `MjData`, which is changed.
        q: joint positions [rad or m].
        parameters: where the base is, if they say.
        sole: frame that shall be level at the world's origin; None: the root link is level.
    """
    mujoco.mj_resetData(built.model, data)
    built.pose(data, q)
    residual = 0.0
    if built.free:
        _set_down(mujoco, built, data, parameters, sole)
        if parameters.position_m is None:
            residual = _balance(mujoco, built, data)
    mujoco.mj_forward(built.model, data)
    data.qacc[:] = 0.0
    mujoco.mj_inverse(built.model, data)
    torques = data.qfrc_inverse @ built.ties.matrix
    mujoco.mj_forward(built.model, data)
    return Start(torques, residual)


def _set_down(
    mujoco: Any, built: MujocoModel, data: Any, parameters: MujocoParameters, sole: str | None
) -> None:
    """Turn and move the root link to where it starts."""
    model, rpy, pose = built.model, parameters.rotation_rad, data.qpos[built.base_q]
    pose[:3] = 0.0
    _turn(mujoco, pose, np.eye(3) if rpy is None else rotation_of(rpy))
    mujoco.mj_kinematics(model, data)
    if sole is not None and rpy is None:
        site = built.site(sole)
        _turn(mujoco, pose, data.site_xmat[site].reshape(3, 3).T)
        mujoco.mj_kinematics(model, data)
        pose[:3] -= data.site_xpos[site]
    if parameters.position_m is not None:
        pose[:3] = parameters.position_m
        return
    floors = [i for i in range(model.ngeom) if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
    theirs = model.body_rootid[model.geom_bodyid] == built.root
    ours = np.flatnonzero(theirs & (model.geom_contype > 0))
    if floors and len(ours):
        mujoco.mj_kinematics(model, data)
        height = max(float(data.geom_xpos[floor, 2]) for floor in floors)
        pose[2] += height - DEEP - min(_lowest(model, data, int(geom)) for geom in ours)


def _lowest(model: Any, data: Any, geom: int) -> float:
    """Height of the lowest corner of the box around a geom."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    up = data.geom_xmat[geom].reshape(3, 3)[2]
    return float(data.geom_xpos[geom, 2] + up @ centre - np.abs(up) @ half)


def _turn(mujoco: Any, pose: FloatArray, rotation: FloatArray) -> None:
    mujoco.mju_mat2Quat(pose[3:7], np.ascontiguousarray(rotation).ravel())


def _balance(mujoco: Any, built: MujocoModel, data: Any) -> float:
    """Newton's method for height, roll and pitch; what is left, as a share of the weight."""
    model = built.model
    weight = float(np.linalg.norm(model.opt.gravity)) * float(model.body_subtreemass[built.root])
    change, here = np.zeros(model.nv), data.qpos[built.base_q]
    moves = built.base_v.start + np.array([2, 3, 4])  # up, and axes of the root link to turn about

    def residual(pose: FloatArray) -> FloatArray:
        here[:] = pose
        data.qvel[:] = data.qacc[:] = 0.0
        mujoco.mj_inverse(model, data)
        return np.array(data.qfrc_inverse[moves])

    def moved(pose: FloatArray, step: FloatArray) -> FloatArray:
        here[:] = pose
        change[:] = 0.0
        change[moves] = step
        mujoco.mj_integratePos(model, data.qpos, change, 1.0)
        return np.array(here, np.float64)

    pose = np.array(here)
    found = residual(pose)
    for _ in range(ROUNDS):
        if weight == 0.0 or np.abs(found).max() <= BALANCED * weight:
            break
        columns = [(residual(moved(pose, axis)) - found) / NUDGE for axis in NUDGES]
        step = -np.asarray(np.linalg.lstsq(np.array(columns).T, found, rcond=1e-9)[0], np.float64)
        step = step * min(1.0, 1e-3 / max(float(np.abs(step).max()), 1e-12))
        for _ in range(HALVINGS):
            candidate = moved(pose, step)
            left = residual(candidate)
            if np.linalg.norm(left) < np.linalg.norm(found):
                break
            step = 0.5 * step
        else:
            break
        pose, found = candidate, left
    here[:] = pose
    return float(np.abs(found).max() / weight) if weight else 0.0
