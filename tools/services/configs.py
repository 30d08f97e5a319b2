"""Where configs are loaded: of emulators and controllers, by name, path or mapping.

Commands and `hoap3.simulate` load configs here, so that a name, a path and a setting mean the same
everywhere.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import apply_overrides, parse
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import CONFIGS as CONTROLLER_CONFIGS
from hoap3.remote_controller.config import ControllerConfig, check_parameters
from hoap3.remote_controller.config import read_config as read_controller_config
from hoap3.remote_controller.controllers.base import mismatch
from hoap3.remote_controller.pairs import configs_for, robots_for
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.config import CONFIGS as EMULATOR_CONFIGS
from hoap3.robot_emulator.config import EmulatorConfig, available_configs
from hoap3.robot_emulator.config import read_config as read_emulator_config
from hoap3.robot_emulator.robots import available as available_robots
from hoap3.robot_emulator.robots import load_configured
from hoap3.robot_emulator.robots.urdf_import.source import DESCRIPTIONS, absolute, is_source
from hoap3.robot_emulator.service import describe
from hoap3.tools.logs.motion_files import enclosed
from hoap3.tools.services.messages import Config

NO_REALTIME = {"policy": "none", "cpu": "none", "lock_memory": False}


def load_emulator_config(
    source: str | Path | Mapping[str, Any] | EmulatorConfig,
    overrides: Sequence[str] = (),
    *,
    seed: int | None = None,
    realtime: bool = True,
) -> tuple[EmulatorConfig, str]:
    """Load the config of an emulator.

    Args:
        source: a shipped config, a robot's name or path, a file, or settings.
        overrides: `dotted.key=value`, each.
        seed: instead of the config's own.
        realtime: False for an ordinary process.

    Returns:
        The config, and where it was read, for errors.

    Raises:
        ConfigError, UnknownNameError: nothing has that name, or a setting is wrong.
    """
    if isinstance(source, EmulatorConfig):
        return source.model_copy(update={} if seed is None else {"seed": seed}), "config"
    content, file = _read_emulator_content(source)
    if seed is not None:
        content = {**content, "seed": seed}
    return _changed(EmulatorConfig, content, file, overrides, realtime=realtime)[0], file


def load_controller_config(
    source: str | Path | Mapping[str, Any] | ControllerConfig,
    overrides: Sequence[str] = (),
    *,
    realtime: bool = True,
) -> tuple[ControllerConfig, str]:
    """Load the config of a controller, and check its parameters; as `load_emulator_config`."""
    if isinstance(source, ControllerConfig):
        return source, "config"
    if isinstance(source, str | Path):
        content, file = read_controller_config(str(source))
    else:
        content, file = _settings(source, "controller"), "config"
    config, label = _changed(ControllerConfig, content, file, overrides, realtime=realtime)
    config = enclosed(config, file)
    check_parameters(config, label)
    return config, file


def _read_emulator_content(source: str | Path | Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Settings as a config has them, or the defaults for a robot; and where they were read."""
    if not isinstance(source, str | Path):
        return _settings(source, "robot"), "config"
    robot, path = str(source), Path(source)
    if robot in available_configs():  # a name comes before a folder that is called so
        return read_emulator_config(robot)
    if robot in available_robots() or robot.startswith(f"{DESCRIPTIONS}:"):
        return {"robot": robot}, f"robot {robot}"
    if os.path.isdir(robot) or path.name == "robot.yaml" or is_source(robot):
        return {"robot": absolute(robot, Path())}, f"robot {robot}"
    return read_emulator_config(robot)


def config_name(file: str) -> str:
    """The name of a shipped config, or of the user's file; "" for settings without a file.

    Args:
        file: where a config was read, as the loaders here return it.
    """
    path = Path(file)
    if path.suffix not in {".yaml", ".yml"}:
        return ""
    return path.stem if path.parent in {EMULATOR_CONFIGS, CONTROLLER_CONFIGS} else path.name


def resolve_configs(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    files: tuple[str, str] = ("config", "config"),
) -> tuple[EmulatorConfig, RobotDescription]:
    """Settle what a robot and a controller leave open to each other: the kind of command.

    Where the emulator's config leaves `command` open, it becomes the first kind that the controller
    gives, in the controller's order, and the robot accepts.

    Args:
        emulator, controller, files: configs of both, and where they were read, for errors.

    Returns:
        The emulator's config with its `command`, and the robot's description.

    Raises:
        UsageError: there is no such robot, or no such controller, or the robot accepts nothing
            that the controller gives, or not what its config names.
    """
    if emulator.command is not None:
        return emulator, describe(emulator, files[0])
    gives = find(controller.controller, files[1]).commands
    robot = load_configured(emulator.robot, files[0], emulator.tip, emulator.lock_joints)
    for kind in gives:
        if kind in robot.command_kinds:
            emulator = emulator.model_copy(update={"command": kind})
            return emulator, describe(emulator, files[0], robot)
    others = _other_pairs(files[1], robot.name)
    raise DescriptionError(f"{mismatch(gives, robot)}: these two do not run together. {others}")


def split_overrides(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    """Overrides of a run: those for the emulator, and those for the controller.

    Raises:
        ConfigError: one begins with neither name.
    """
    sides: dict[str, list[str]] = {"emulator": [], "controller": []}
    for override in overrides:
        side, _, rest = override.partition(".")
        if side not in sides:
            raise ConfigError(
                "--set",
                override.partition("=")[0],
                override,
                "belongs to neither side",
                "Begin with `emulator.` or `controller.`",
            )
        sides[side].append(rest)
    return sides["emulator"], sides["controller"]


def load_pair(
    robot: str | None,
    controller: str,
    overrides: Sequence[str],
    more: tuple[Sequence[str], Sequence[str]] = ((), ()),
    *,
    realtime: bool = True,
) -> tuple[EmulatorConfig, ControllerConfig, tuple[str, str]]:
    """Load the configs of a run.

    Args:
        robot: as for `load_emulator_config`; None: what the controller's config names.
        controller: as for `load_controller_config`.
        overrides: as for `split_overrides`.
        more: overrides of each side that come before those.
        realtime: False for ordinary processes.

    Returns:
        The config of the emulator and of the controller, and where they were read, for errors.

    Raises:
        ConfigError, UnknownNameError: nothing has that name, or a setting is wrong.
    """
    ours, theirs = split_overrides(overrides)
    law, law_file = load_controller_config(controller, [*more[1], *theirs], realtime=realtime)
    emulator, file = load_emulator_config(robot or law.robot, [*more[0], *ours], realtime=realtime)
    return emulator, law, (file, law_file)


def _other_pairs(file: str, robot: str) -> str:
    """What runs instead of a pair that does not, as text."""
    configs, robots = configs_for(robot), robots_for(file)
    choices = [f"--robot {' or '.join(robots)}"] if robots else []
    choices += [f"a config for {robot!r}: {', '.join(configs)}"] if configs else []
    return f"Take {', or '.join(choices)}" if choices else "Choose another robot or controller"


def _changed(
    model: type[Config],
    content: dict[str, Any],
    file: str,
    overrides: Sequence[str],
    *,
    realtime: bool,
) -> tuple[Config, str]:
    """Settings as `--set` and `--no-realtime` change them, and what errors call them."""
    content = apply_overrides(content, overrides)
    label = f"{file} with --set" if overrides else file
    given_realtime = content.get("realtime", {})
    if not realtime and isinstance(given_realtime, dict):  # else it is refused below
        content["realtime"] = {**given_realtime, **NO_REALTIME}
    return parse(model, content, label), label


def _settings(given: object, what: str) -> dict[str, Any]:
    """A mapping as it is."""
    if isinstance(given, Mapping):
        return dict(given)
    remedy = f"Give a name, a path, or settings such as {{'{what}': …}}"
    raise ConfigError("config", what, type(given).__name__, "names no " + what, remedy)
