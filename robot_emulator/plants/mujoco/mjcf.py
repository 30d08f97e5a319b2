"""What MuJoCo reads: an MJCF file without its motors, joints and base as they must be."""

from __future__ import annotations

from typing import Any

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters

ACTUATOR = (
    *("actearly", "actlimited", "actrange", "armature", "biasprm", "biastype", "cranklength"),
    *("ctrllimited", "ctrlrange", "damping", "delay", "dynprm", "dyntype", "forcelimited"),
    *("forcerange", "gainprm", "gaintype", "gear", "inheritrange", "interp", "lengthrange"),
    "nsample",
)
GEOM = ("adhesion", "condim", "gap", "margin", "priority", "solimp", "solmix", "solref")
UNHEEDED: dict[str, Any] = {"collide": "auto", "joint_friction": True}
"""Settings that apply to a URDF only, and their defaults."""


def refuse_unheeded(parameters: MujocoParameters) -> None:
    """Refuse what a file decides by itself.

    Raises:
        ConfigError: with a key below `plant`.
    """
    for key, usual in UNHEEDED.items():
        value = getattr(parameters, key)
        if parameters.mjcf is not None and value != usual:
            problem = "is for a URDF: contacts and friction of an MJCF file are its own"
            raise ConfigError("", f"parameters.{key}", value, problem, "Leave it out")


def read_mjcf(mujoco: Any, path: str) -> tuple[Any, int]:
    """Read a file without its actuators, what refers to them, and defaults for new ones.

    Returns:
        A spec, and how many actuators the file had.

    Raises:
        ConfigError: MuJoCo cannot read it.
    """
    try:
        spec = mujoco.MjSpec.from_file(path)
    except (ValueError, OSError) as error:
        problem = f"MuJoCo cannot read it: {' '.join(str(error).split())}"
        raise ConfigError("", "parameters.mjcf", path, problem, "Correct the file") from error
    for sensor in list(spec.sensors):
        if sensor.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR:
            spec.delete(sensor)
    count = len(spec.actuators)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for key in spec.keys:
        key.ctrl, key.act = [], []
    _forget_defaults(mujoco, spec)
    return spec, count


def _forget_defaults(mujoco: Any, spec: Any) -> None:
    """Have what we add be as MuJoCo has it: what was read has the file's <default> already."""
    blank = mujoco.MjSpec()
    for kind, keys in (("actuator", ACTUATOR), ("geom", GEOM)):
        ours, usual = getattr(spec.default, kind), getattr(blank.default, kind)
        for key in keys:
            setattr(ours, key, getattr(usual, key))


def check_joints(
    mujoco: Any, spec: Any, description: RobotDescription, parameters: MujocoParameters
) -> None:
    """Refuse joints that are missing or of another type, and settings of joints that do not fit.

    Raises:
        ConfigError: with a key below `plant`.
    """
    known = [joint.name for joint in spec.joints]
    for name in description.joint_names:
        if name not in known:
            hint = one_of(name, known, "Its joints")
            raise ConfigError("", "parameters.mjcf", name, "the file lacks this joint", hint)
    for key in ("kp", "kv", "armature"):
        given = getattr(parameters, key)
        for name, value in given.items() if isinstance(given, dict) else ():
            if key != "armature" and not value > 0.0:
                problem, remedy = "a servo needs some", "Write a number above 0"
                raise ConfigError("", f"parameters.{key}.{name}", value, problem, remedy)
            if name not in description.joint_names:
                hint = one_of(name, description.joint_names, "Its joints")
                problem = f"robot {description.name!r} has no such joint"
                raise ConfigError("", f"parameters.{key}", name, problem, hint)
    _check_types(mujoco, spec, description)


def _check_types(mujoco: Any, spec: Any, description: RobotDescription) -> None:
    """Refuse joints of a file that move otherwise than those of the description."""
    types = mujoco.mjtJoint
    told = {types.mjJNT_HINGE: "turns", types.mjJNT_SLIDE: "slides"}
    for name in description.joint_names:
        kind = description.structure.movable[name].kind
        wanted = "slides" if kind == "prismatic" else "turns"
        found = told.get(spec.joint(name).type, "has more than one degree of freedom")
        if found != wanted:
            problem = f"the joint {found} in the file, and {wanted} in the description"
            remedy = "Correct the one that is wrong"
            raise ConfigError("", "parameters.mjcf", name, problem, remedy)


def check_base(parameters: MujocoParameters, *, free: bool, trees: int) -> None:
    """Refuse a base of a file that is not as the settings say.

    Args:
        parameters: of the plant.
        free: whether the file's may move.
        trees: how many bodies on the world the joints hang from.

    Raises:
        ConfigError: with a key below `plant`.
    """
    if free != (parameters.base == "free"):
        found = "free" if free else "fixed"
        problem, remedy = f"its base is {found}", f"Write base: {found}, or change the file"
        raise ConfigError("", "parameters.mjcf", parameters.mjcf, problem, remedy)
    if free and trees > 1:
        problem, remedy = "its joints hang from several bodies", "Name those of one robot"
        raise ConfigError("", "parameters.mjcf", parameters.mjcf, problem, remedy)
