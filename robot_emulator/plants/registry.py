"""Plants by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

from typing import Any, cast

from hoap3.protocol.config.plugins import PluginGroup
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.base import TOLD, Declared, Plant

GROUP = "hoap3.plants"
_OURS = "hoap3.robot_emulator.plants"
BUILTIN = {
    "servo": f"{_OURS}.position_servo:PositionServo",
    "acceleration": f"{_OURS}.acceleration_servo:AccelerationServo",
    "rigid_body": f"{_OURS}.rigid_body:RigidBody",
    "mujoco": f"{_OURS}.mujoco.plant:MujocoPlant",
}
USUAL: dict[CommandKind, str] = {
    "position": "servo",
    "acceleration": "acceleration",
    "torque": "rigid_body",
}
"""What a robot has whose config names no `plant.kind`."""

PLANTS = PluginGroup("plant", GROUP, BUILTIN, (f"{_OURS}.base:Plant",), "plants")
registered = PLANTS.registered

_REFUSED = ("servo", "encoder", "contacts")
"""Keys of `plant` that a plant must heed where they are not as usual; the others stand by."""


def find_plant(
    settings: PlantSettings, kind: CommandKind, file: str = "config"
) -> tuple[type[Plant], Settings]:
    """The class of a plant, and its parameters.

    Args:
        settings: `plant` of a config.
        kind: what setpoints are.
        file: where it stands, for errors.

    Raises:
        UnknownNameError, ConfigError: it cannot be found or imported, takes no such setpoints, or
            its parameters are wrong.
    """
    name = settings.kind or USUAL[kind]
    plant = cast("type[Plant]", PLANTS.find(name, file, "plant.kind"))
    if kind not in plant.commands:
        takes = " or ".join(plant.commands)
        fits = [each for each in BUILTIN if kind in PLANTS.find(each).commands]
        remedy = f"Write {' or '.join(fits)}, or set command to {takes}"
        raise ConfigError(file, "plant.kind", name, f"takes {takes}, not {kind}", remedy)
    for key in _REFUSED:
        value, usual = getattr(settings, key), PlantSettings.model_fields[key].default
        if key not in plant.heeds and value != usual:
            found = f"{len(value)} of them" if isinstance(value, tuple) else value
            problem, remedy = _not_heeded(key, name, kind)
            raise ConfigError(file, f"plant.{key}", found, problem, remedy)
    return plant, parse(plant.Parameters, settings.parameters, file, "plant.parameters")


def _not_heeded(key: str, name: str, kind: str) -> tuple[str, str]:
    """What is wrong with a key that a plant does not read, and what to do."""
    if key == "contacts":
        problem = f"are for torque commands, not {kind}: only such a body feels a force"
        if kind == "torque":
            problem = f"are for the plant rigid_body, not {name}"
        return problem, "Leave them out, or write command: torque"
    if kind == "position":
        return f"is for the plant servo, not {name}", "Leave it out"
    usual = PlantSettings.model_fields[key].default
    return f"is for position commands, not {kind}", f"Write {usual}"


def declared(
    description: RobotDescription, settings: PlantSettings, kind: CommandKind, file: str
) -> dict[str, Any]:
    """What a plant adds to the description of its robot; `state_arrays` are its own only.

    Raises:
        UnknownNameError, ConfigError: as `find_plant`, and as the plant says.
    """
    plant, parameters = find_plant(settings, kind, file)
    description = description.model_copy(
        update={"command_kinds": (kind,), "gravity": settings.gravity}
    )
    with located(file, "plant"):
        said: Declared = plant.declare(description, settings, parameters)
    lengths = {name: getattr(said, name) for name in TOLD if getattr(said, name)}
    joints = description.joints
    if said.armature is not None:
        joints = tuple(
            joint.model_copy(update={"armature": armature})
            for joint, armature in zip(joints, said.armature, strict=True)
        )
    return {"state_arrays": lengths, "servo_rate_1_s": said.servo_rate_1_s, "joints": joints}


def build_plant(
    description: RobotDescription, settings: PlantSettings, seed: int, file: str = "config"
) -> Any:
    """The configured plant of a robot; errors as `find_plant`, and what it raises itself."""
    plant, parameters = find_plant(settings, description.command_kinds[0], file)
    with located(file, "plant"):
        return plant.configured(description, settings, parameters, seed)
