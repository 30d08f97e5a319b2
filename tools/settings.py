"""`hoap3 config`: settings as they will be used, checked, and described for editors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from protocol.errors import UnknownNameError
from protocol.settings import load_yaml
from remote_controller.config import ControllerConfig
from remote_controller.config import available_configs as controller_configs
from remote_controller.registry import find, is_registered, registered
from robot_emulator.config import EmulatorConfig
from robot_emulator.config import available_configs as emulator_configs
from robot_emulator.robots import available as robots
from robot_emulator.service import describe
from tools.services import as_yaml, controller_config, emulator_config


def resolved(name: str, overrides: list[str]) -> tuple[str, str]:
    """The whole of a config as YAML, and which side it belongs to; checked as at a start.

    Raises:
        UnknownNameError: nothing has that name.
        UsageError: what it says is wrong.
    """
    known = {*emulator_configs(), *robots(), *controller_configs(), *registered()}
    path = Path(name)
    if not (name in known or ":" in name or path.suffix in {".yaml", ".yml"} or path.exists()):
        raise UnknownNameError("config", name, known, " Or name a file.")
    if _is_emulator(name):
        settings, file = emulator_config(name, overrides)
        describe(settings, file)
        return as_yaml(settings), "an emulator"
    config, file = controller_config(name, overrides)
    parameters = find(config.controller, file).Parameters.model_validate(config.parameters)
    whole = config.model_copy(update={"parameters": parameters.model_dump(mode="json")})
    return as_yaml(whole), "a controller"


def json_schema(kind: str) -> dict[str, Any]:
    """JSON Schema of a side's config, or of a controller's whole config.

    Raises:
        UnknownNameError: neither a side nor a controller.
    """
    if kind == "emulator":
        return EmulatorConfig.model_json_schema()
    if kind == "controller":
        return ControllerConfig.model_json_schema()
    if not (is_registered(kind) or ":" in kind):
        raise UnknownNameError("kind of config", kind, ["emulator", "controller", *registered()])
    schema = ControllerConfig.model_json_schema()
    parameters = find(kind).Parameters.model_json_schema()
    schema.setdefault("$defs", {}).update(parameters.pop("$defs", {}))
    schema["properties"]["parameters"] = parameters
    return schema


def _is_emulator(name: str) -> bool:
    if name in emulator_configs() or name in robots():
        return True
    if name in controller_configs():
        return False
    path = Path(name)
    if path.is_dir():
        return True
    return path.is_file() and "controller" not in load_yaml(path)
