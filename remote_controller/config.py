"""Settings of the remote controller."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from pydantic import Field

from hoap3.protocol.config.endpoints import Endpoint
from hoap3.protocol.config.plugins import building
from hoap3.protocol.config.regular_file import check_path
from hoap3.protocol.config.settings import (
    LinkSettings,
    LogSettings,
    MetricsSettings,
    RealtimeSettings,
    Settings,
    load_yaml,
    parse,
    parse_yaml,
)
from hoap3.protocol.config.user_code import may_import
from hoap3.protocol.config.wrong_settings import NAME_PATTERN, ROBOT_PATTERN
from hoap3.protocol.errors import (
    ConfigError,
    DescriptionError,
    NoDefaultTaskError,
    UnknownNameError,
    located,
)
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.limits_above import warn_of_limits_above
from hoap3.remote_controller.pairs import configs_for, robots_for
from hoap3.remote_controller.references.live.live import check_names, collected

CONFIGS = Path(__file__).parent / "configs"


class ControllerLink(LinkSettings):
    """Where the robot is."""

    connect: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="endpoints to connect to"
    )


class ControllerConfig(Settings):
    """One remote controller."""

    controller: str = Field(description="registered name, or package.module:Class")
    robot: str = Field(
        "hoap3", pattern=ROBOT_PATTERN, description="name of the robot on the network, or its path"
    )
    parameters: dict[str, Any] = Field({}, description="settings of the controller itself")
    link: ControllerLink = ControllerLink()
    realtime: RealtimeSettings = RealtimeSettings()
    log: LogSettings = LogSettings()
    metrics: MetricsSettings = MetricsSettings()


def is_name(robot: str) -> bool:
    """Whether the key `robot` of a config is a name on the network, rather than a path."""
    return re.fullmatch(NAME_PATTERN, robot) is not None


def available_configs() -> list[str]:
    """Names of the shipped configs."""
    return sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def read_config(name: str) -> tuple[dict[str, Any], str]:
    """Content and file name of a shipped config, of the user's own, or of a bare controller.

    A relative path of a robot counts from the folder of the file that names it. That of the user's
    own file joins the end of the import path, so that a controller can lie beside it; not where
    `user_code` forbids to import it. A name that starts with { is the content itself.

    Raises:
        ConfigError: the file cannot be read, or a path leads nowhere.
        UnknownNameError: neither a shipped config, nor a file, nor a controller.
    """
    if name in available_configs():
        path = CONFIGS / f"{name}.yaml"
        return load_yaml(path), str(path)
    from hoap3.remote_controller.registry import registered

    path = Path(name)
    if name in registered():  # a name comes before a folder that is called so
        return {"controller": name}, f"controller {name}"
    if name.lstrip().startswith("{"):
        return parse_yaml(name, "--controller"), "--controller"
    if path.suffix in {".yaml", ".yml"} or os.path.exists(name):
        content = load_yaml(path)
        robot = content.get("robot")
        given, *arguments = re.split(r"(\s+\w+:=)", str(robot), maxsplit=1)  # of xacro
        if isinstance(robot, str) and ("/" in given or "." in given):
            place = str((path.parent / given).resolve())
            content["robot"] = "".join((place, *arguments))
            if not os.path.exists(place):
                remedy = "Name a robot, its folder, YAML file or URDF; paths count from the config"
                raise ConfigError(str(path), "robot", place, "no such file or folder", remedy)
        folder = str(path.resolve().parent)
        if folder not in sys.path and may_import():
            sys.path.append(folder)
        return content, str(path)
    if ":" in name:
        return {"controller": name}, f"controller {name}"
    check_path(name, "a controller's config, a YAML file")
    known = {*available_configs(), *registered()}
    raise UnknownNameError("controller config", name, known, " Or name a file.")


def build(config: ControllerConfig, description: RobotDescription, file: str = "config") -> Any:
    """The configured controller for a robot.

    Raises:
        UnknownNameError, ConfigError: it cannot be found, its parameters are wrong, the robot
            lacks a frame that they name, or the controller cannot be built for it.
    """
    from hoap3.remote_controller.registry import find

    controller = find(config.controller, file)
    parameters = _parameters(controller, config, file)
    try:
        keys = "controller", "parameters"
        with (
            collected() as live,
            building(controller, config.controller, description, parameters, file, *keys),
        ):
            built = controller.configured(description, parameters, file)
    except ConfigError as error:
        hint = of_another_robot(config, description)
        if not hint or isinstance(error, NoDefaultTaskError):  # which any robot can have
            raise
        remedy = f"{error.remedy}. {hint}"
        raise ConfigError(
            error.file, error.key, error.value, error.problem, remedy, error.others
        ) from error
    except DescriptionError as error:
        hint = of_another_robot(config, description) or _runs_on(file, description)
        raise (DescriptionError(f"{error}. {hint}") if hint else error) from error
    built.live = tuple(live)
    built.begin_changes()
    with located(file, "parameters"):
        check_names(built.live)
    warn_of_limits_above(description, parameters, file)
    return built


def of_another_robot(config: ControllerConfig, description: RobotDescription) -> str:
    """What to add to an error where a config names another robot than it is used for, else "".

    That alone is no error: robots may be called anything.
    """
    given = description.name
    named = "robot" in config.model_fields_set and is_name(config.robot)
    if not named or config.robot == given:
        return ""
    fitting = configs_for(given)
    listing = f": {', '.join(fitting)}" if fitting else ""
    return (
        f"The config is for another robot: its key `robot` names {config.robot!r}, and {given!r} "
        f"is given. Take --robot {config.robot}, or a config for {given!r}{listing}"
    )


def _runs_on(file: str, description: RobotDescription) -> str:
    """Which robots a shipped config is for, where that is not this one, else ""."""
    robots = robots_for(file)
    if not robots or description.name in robots:
        return ""
    return f"This config is for --robot {' or '.join(robots)} (`hoap3 help robots`)"


def check_parameters(config: ControllerConfig, file: str) -> None:
    """Refuse a controller or parameters that are wrong for any robot."""
    from hoap3.remote_controller.registry import find

    controller = find(config.controller, file)
    controller.check(_parameters(controller, config, file), file)


def _parameters(controller: Any, config: ControllerConfig, file: str) -> Settings:
    """The parameters of a controller.

    Raises:
        ConfigError: they are wrong; of constraints where it takes none, which controllers do.
    """
    given = config.parameters.get("constraints")
    if given is not None and "constraints" not in controller.Parameters.model_fields:
        from hoap3.remote_controller.registry import of_constraints

        problem = f"{config.controller} takes no constraints"
        remedy = f"Take {', '.join(of_constraints())}, or leave them out"
        raise ConfigError(file, "parameters.constraints", given, problem, remedy)
    parameters: Settings = parse(controller.Parameters, config.parameters, file, "parameters")
    return parameters
