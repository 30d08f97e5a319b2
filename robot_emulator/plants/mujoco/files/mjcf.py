"""An MJCF file of the user's own: read without its motors, and checked."""

from __future__ import annotations

from typing import Any

from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters

ACTUATOR = (
    *("actearly", "actlimited", "actrange", "armature", "biasprm", "biastype", "cranklength"),
    *("ctrllimited", "ctrlrange", "damping", "delay", "dynprm", "dyntype", "forcelimited"),
    *("forcerange", "gainprm", "gaintype", "gear", "inheritrange", "interp", "lengthrange"),
    "nsample",
)
GEOM = ("adhesion", "condim", "gap", "margin", "priority", "solimp", "solmix", "solref")
UNHEEDED: dict[str, Any] = {"collide": "auto", "joint_friction": True}
"""Settings that are for a URDF, and what they are where nobody wrote them."""


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
