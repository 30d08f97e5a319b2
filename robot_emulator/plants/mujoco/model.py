"""MuJoCo's model of a described robot and of what stands around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import ConfigError, NotInstalledError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.collisions import keep_apart, let_touch, surround
from hoap3.robot_emulator.plants.mujoco.inertias import repair
from hoap3.robot_emulator.plants.mujoco.mjcf import check_joints, read_mjcf
from hoap3.robot_emulator.plants.mujoco.rerooted_urdf import (
    body_of,
    rerooted,
    root_inertia,
    without_world,
)
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters
from hoap3.robot_emulator.plants.mujoco.ties import Ties, ties_of

MOTORS, SERVOS = 0, 1  # groups of actuators
FRAME = "frame "  # before the name of a frame that MuJoCo has as a site
NO_END = 1e9  # rad: where a joint that has one stop only has its other one
RIGID = [0.9999, 0.9999]  # share of what breaks an equality that MuJoCo undoes: the most it takes
IMU = "quaternion", "gyro", "accelerometer"
"""Sensors of an inertial unit; each name stands before that of its frame."""


@dataclass(frozen=True)
class MujocoModel:
    """MuJoCo's model, and where the robot's parts are in it; arrays in wire order.

    Attributes:
        model: `mujoco.MjModel`.
        q_at, v_at: (n,) where each joint is in qpos and qvel.
        ties: what all coordinates have to do with the joints of the wire.
        free: whether the root link may move.
        root: MuJoCo's number of the root link's body, 0 where the world holds it.
        base_q, base_v: where a free root link is in qpos and qvel.
        trees: bodies on the world that the robot hangs from: not what else a file has.
        welded: the link that the world holds, "" of a free base.
        urdf: text of what was read, with `welded` as its root; "" of an MJCF file.
        altered: by body, what MuJoCo did not take as the URDF has it.
        actuators: how many an MJCF file had, which the robot's own replace.
    """

    model: Any
    q_at: NDArray[np.intp]
    v_at: NDArray[np.intp]
    ties: Ties
    free: bool
    root: int
    base_q: slice
    base_v: slice
    trees: NDArray[np.intp]
    welded: str
    urdf: str
    altered: Mapping[str, str]
    actuators: int = 0

    def pose(self, data: Any, q: FloatArray) -> None:
        """Set the joints of an `MjData` to `q`, (n,), and mimic joints accordingly."""
        data.qpos[self.q_at] = q
        ties = self.ties
        data.qpos[ties.mimic_joints] = ties.multipliers * q[ties.mimicked] + ties.offsets

    def site(self, frame: str) -> int:
        """MuJoCo's number of the site that stands for a frame."""
        sites = [self.model.site(place).name for place in range(self.model.nsite)]
        return sites.index(FRAME + frame if FRAME + frame in sites else frame)


def mujoco_module() -> Any:
    """The package, which is an extra.

    Raises:
        NotInstalledError: it is not installed; says how to.
    """
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise NotInstalledError("plant", "mujoco", "'hoap3[mujoco]'") from error
    mujoco.set_mju_user_warning(_quiet)
    return mujoco


def _quiet(text: str) -> None:
    """Take a warning that MuJoCo would write to a file in the working directory.

    `MjData.warning` counts it, and the plant's summary tells.
    """
    del text


def build_model(
    description: RobotDescription,
    parameters: MujocoParameters,
    frames: tuple[str, ...] = (),
    imus: tuple[str, ...] = (),
) -> MujocoModel:
    """Make a robot's model.

    Args:
        description: of the robot; the first of its `command_kinds` decides about its motors.
        parameters: of the plant.
        frames: that sites shall stand for.
        imus: those of them that have an inertial unit.

    Raises:
        ConfigError: with a key below `plant`; MuJoCo refuses the robot, or the file lacks a joint
            or a frame.
        NotInstalledError: MuJoCo is missing.
    """
    mujoco = mujoco_module()
    free = parameters.base == "free"
    moved = description.base_frame in description.structure.moving
    welded = description.base_frame if moved else description.structure.root
    urdf, altered, actuators = "", dict[str, str](), 0
    if parameters.mjcf is not None:
        spec, actuators = read_mjcf(mujoco, parameters.mjcf)
        welded = ""
    else:
        urdf = description.urdf if free or not moved else rerooted(description.urdf, welded)
        spec, altered = _from_urdf(mujoco, urdf, parameters, description)
    check_joints(mujoco, spec, description, parameters)
    _add_frames(spec, frames, file=parameters.mjcf is not None)
    _add_imus(spec, mujoco, imus)
    _set_joints(spec, mujoco, description, parameters)
    _set_options(spec, mujoco, description, parameters)
    surround(spec, mujoco, parameters)
    if not urdf:
        built = _assembled(mujoco, _compiled(spec, description), description, "", urdf, altered)
        return replace(built, actuators=actuators)
    let_touch(spec, description, parameters)
    touching = _compiled(spec.copy(), description)
    start = mujoco.MjData(touching)
    built = _assembled(mujoco, touching, description, "", urdf, altered)
    built.pose(start, description.initial_position)
    mujoco.mj_forward(touching, start)
    keep_apart(spec, touching, start)
    model = _compiled(spec, description)
    return _assembled(mujoco, model, description, "" if free else welded, urdf, altered)


def _from_urdf(
    mujoco: Any, urdf: str, parameters: MujocoParameters, description: RobotDescription
) -> tuple[Any, dict[str, str]]:
    """A spec of a URDF, with the inertia of its root, which MuJoCo leaves out.

    Returns:
        That, and by body what MuJoCo does not take as it is.
    """
    try:
        spec = mujoco.MjSpec.from_string(without_world(urdf))
    except ValueError as error:
        problem = f"MuJoCo cannot read its URDF: {_one_line(error)}"
        raise ConfigError("", "kind", description.name, problem, "Correct the URDF") from error
    compiler = spec.compiler
    compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    step = description.period_s / parameters.substeps
    for equality in spec.equalities:  # springs, which shall give way as little as they can
        equality.solref, equality.solimp[:2] = [2.0 * step, 1.0], RIGID
    if not parameters.joint_friction:
        for joint in spec.joints:
            joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
    if parameters.base == "free":
        root = spec.body(body_of(description.structure.root))
        mass, centre, inertia = root_inertia(urdf, description.structure.root)
        if mass > 0.0:
            root.mass, root.ipos, root.explicitinertial = mass, centre, True
            root.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        root.add_freejoint()
    return spec, repair(spec)


def _add_frames(spec: Any, frames: tuple[str, ...], *, file: bool) -> None:
    """Sites for frames: links of a URDF; bodies or sites of a file."""
    for frame in frames:
        body = spec.body(frame if file else body_of(frame))
        site = spec.site(frame) if file else None
        if site is None and body is not None:
            body.add_site(name=FRAME + frame, pos=[0.0, 0.0, 0.0], quat=[1.0, 0.0, 0.0, 0.0])
        elif site is None:
            known = [each.name for each in (*spec.bodies, *spec.sites)]
            hint = one_of(frame, known, "Its bodies and sites")
            raise ConfigError("", "parameters.mjcf", frame, "the file has no such frame", hint)


def _site_name(spec: Any, frame: str) -> str:
    """Of the site that stands for a frame: ours on a body, or the file's own."""
    return FRAME + frame if spec.site(FRAME + frame) is not None else frame


def _add_imus(spec: Any, mujoco: Any, frames: tuple[str, ...]) -> None:
    kinds = mujoco.mjtSensor
    types = kinds.mjSENS_FRAMEQUAT, kinds.mjSENS_GYRO, kinds.mjSENS_ACCELEROMETER
    for frame in frames:
        for name, kind in zip(IMU, types, strict=True):
            sensor = spec.add_sensor(name=f"{name} {frame}", type=kind)
            sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_SITE, _site_name(spec, frame)


def _set_joints(
    spec: Any, mujoco: Any, description: RobotDescription, parameters: MujocoParameters
) -> None:
    """Stops, rotors, efforts and motors of the joints of the wire."""
    torques = description.command_kinds[0] != "position"
    robot = description
    figures = robot.lower_hard, robot.upper_hard, robot.effort, robot.armature
    for joint, lower, upper, effort, rotor in zip(robot.joints, *figures, strict=True):
        ours = spec.joint(joint.name)
        ours.limited = bool(np.isfinite(lower) or np.isfinite(upper))
        if ours.limited:  # any range here: a file may count in degrees, the model never does
            ours.range = [-1.0, 1.0]
        ours.armature = _of(parameters.armature, joint.name, rotor)
        if 0.0 < effort < np.inf:
            ours.actfrclimited, ours.actfrcrange = True, [-effort, effort]
        for group in (MOTORS, SERVOS) if torques else (SERVOS,):
            name = f"{joint.name} {'servo' if group == SERVOS else 'motor'}"
            actuator = spec.add_actuator(name=name, target=joint.name, group=group)
            actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
            if group == SERVOS:  # gains that are not given come with the start posture
                kp = _of(parameters.kp, joint.name, 1.0)
                actuator.set_to_position(kp=kp, kv=_of(parameters.kv, joint.name, 1.0))
            else:
                actuator.set_to_motor()
    if description.gravity == "compensated":
        for body in spec.bodies[1:]:
            body.gravcomp = 1.0
        for joint in description.joints:
            spec.joint(joint.name).actgravcomp = True


def _set_options(
    spec: Any, mujoco: Any, description: RobotDescription, parameters: MujocoParameters
) -> None:
    spec.option.timestep = description.period_s / parameters.substeps
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if description.gravity == "none":
        spec.option.gravity = [0.0, 0.0, 0.0]


def _compiled(spec: Any, description: RobotDescription) -> Any:
    try:
        return spec.compile()
    except ValueError as error:
        problem = f"MuJoCo refuses its model: {_one_line(error)}"
        remedy = "Correct that part of its URDF or MJCF file"
        raise ConfigError("", "kind", description.name, problem, remedy) from error


def _assembled(
    mujoco: Any,
    model: Any,
    description: RobotDescription,
    welded: str,
    urdf: str,
    altered: dict[str, str],
) -> MujocoModel:
    joints = [model.joint(name) for name in description.joint_names]
    stops = np.transpose([description.lower_hard, description.upper_hard])
    model.jnt_range[[joint.id for joint in joints]] = np.clip(stops, -NO_END, NO_END)
    ties = ties_of(mujoco, model, [int(joint.id) for joint in joints])
    moved = np.flatnonzero(ties.matrix.any(axis=1))
    trees = np.unique(model.body_rootid[model.dof_bodyid[moved]]).astype(np.intp)
    first = int(model.body_jntadr[trees[0]])
    free = first >= 0 and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE
    q_of, v_of = (int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])) if free else (0, 0)
    return MujocoModel(
        model=model,
        q_at=np.array([joint.qposadr[0] for joint in joints], np.intp),
        v_at=np.array([joint.dofadr[0] for joint in joints], np.intp),
        ties=ties,
        free=bool(free),
        root=int(trees[0]) if free else 0,
        base_q=slice(q_of, q_of + 7),
        base_v=slice(v_of, v_of + 6),
        trees=trees,
        welded=welded,
        urdf=urdf,
        altered=altered,
    )


def _of(given: float | dict[str, float] | None, joint: str, otherwise: float) -> float:
    """What a setting says of a joint."""
    if isinstance(given, dict):
        return given.get(joint, otherwise)
    return otherwise if given is None else given


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
