"""`hoap3 config`: settings as they will be used, checked, and described for editors."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic_core import to_jsonable_python

from hoap3.protocol.config.regular_file import check_path
from hoap3.protocol.config.settings import Settings, apply_overrides, load_yaml, parse
from hoap3.protocol.config.user_code import UserCode
from hoap3.protocol.config.wrong_settings import likeness
from hoap3.protocol.errors import ConfigError, UnknownNameError, UsageError, one_of
from hoap3.remote_controller import registry as controllers
from hoap3.remote_controller.config import ControllerConfig, build, is_name
from hoap3.remote_controller.config import available_configs as controller_configs
from hoap3.remote_controller.config import read_config as read_controller_config
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.constraints.registry import ConstraintSettings
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.remote_controller.tasks.curve_following.curve import CURVES
from hoap3.remote_controller.tasks.registry import TaskSettings
from hoap3.robot_emulator.config import EmulatorConfig, PlantSettings
from hoap3.robot_emulator.config import available_configs as emulator_configs
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.registry import PLANTS
from hoap3.robot_emulator.robots import available as robots
from hoap3.robot_emulator.robots.urdf_import.source import is_source
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import (
    load_controller_config,
    load_emulator_config,
    resolve_configs,
)
from hoap3.tools.services.services import as_yaml

SOME_KEYS = 50  # of a file, by which its side is told


def _read(name: str, overrides: list[str]) -> tuple[EmulatorConfig | ControllerConfig, str]:
    """A config and where it was read; checked as at a start.

    Raises:
        UnknownNameError: nothing has that name.
        UsageError: what it says is wrong.
    """
    known = {*emulator_configs(), *robots(), *controller_configs(), *controllers.registered()}
    path = Path(name)
    named = name in known or ":" in name or path.suffix in {".yaml", ".yml"}
    if not (named or is_source(name) or os.path.exists(name)):
        check_path(name, "a config, or a robot's folder, YAML file or URDF")
        raise UnknownNameError("config", name, known, " Or name a file.")
    if not _is_emulator(name):
        return load_controller_config(name, overrides)
    settings, file = load_emulator_config(name, overrides)
    describe(settings, file)
    return settings, file


def shown(name: str, overrides: list[str], code: UserCode) -> str:
    """The whole of a config as YAML.

    Where `code` forbids an import that the defaults of its parameters need, the parameters are as
    they are written.

    Raises:
        UnknownNameError: nothing has that name.
        UsageError: what it says is wrong.
    """
    try:
        config, file = _read(name, overrides)
        if isinstance(config, EmulatorConfig):
            return as_yaml(config)
        own = controllers.find(config.controller, file).Parameters
        parameters = parse(own, config.parameters, file, "parameters").model_dump(mode="json")
        return as_yaml(config.model_copy(update={"parameters": parameters}))
    except ConfigError:
        if code.allowed or not code.names:
            raise
    content, file = read_controller_config(name)
    return as_yaml(parse(ControllerConfig, apply_overrides(content, overrides), file))


def checked(name: str, overrides: list[str], robot: str | None = None) -> str:
    """What a config is found to be, in words; a controller is built for its robot.

    Args:
        name: a config, a robot or a controller; a name or a path.
        overrides: `dotted.key=value`, each.
        robot: robot or emulator config to build a controller for; None for the one that its
            config names.

    Raises:
        UsageError: what `run` would refuse as well, or a robot for what is none's controller.
    """
    config, file = _read(name, overrides)
    if isinstance(config, EmulatorConfig):
        if robot is not None:
            raise UsageError(f"{name}: is the config of an emulator. Leave --robot out")
        description = describe(config, file)
        start = description.postures[description.initial_posture]
        build_body(description, config)[1].reset(np.array(start))
        return "a correct config of an emulator"
    file = f"{file} with --set" if overrides else file
    correct = "a correct config of a controller"
    if robot is None:
        unchecked = "so what depends on it was not checked: name one with --robot"
        if "robot" not in config.model_fields_set:
            return f"{correct}; it names no robot, {unchecked}"
        known = {*robots(), *emulator_configs()}
        if is_name(config.robot) and config.robot not in known:  # one of the network may have it
            like = one_of(config.robot, sorted(known), "Known")
            return f"{correct}; no robot {config.robot!r} is known here, {unchecked}. {like}"
    emulator, source = load_emulator_config(robot or config.robot, [])
    _, description = resolve_configs(emulator, config, (source, file))
    build(config, description, file)
    return f"{correct} for robot {description.name}"


FAMILIES: dict[str, tuple[Any, type[Settings]]] = {
    "controller": (controllers, ControllerConfig),
    "task": (tasks, TaskSettings),
    "constraint": (constraints, ConstraintSettings),
    "plant": (PLANTS, PlantSettings),
}
"""What has parameters of its own: the registry of its names, and what a config says of one."""


def json_schema(kind: str, name: str | None = None) -> dict[str, Any]:
    """JSON Schema of a side's config, of a controller's whole config, or of an entry in one.

    Args:
        kind: "emulator", one of `FAMILIES`, or a controller's name.
        name: of one of that family; its parameters are part of the schema then.

    Raises:
        UnknownNameError: nothing is called so.
        ConfigError: what is called so cannot be imported, or is something else.
    """
    if name is not None:
        if kind not in FAMILIES:
            raise UnknownNameError("kind of config with names", kind, FAMILIES)
        registry, whole = FAMILIES[kind]
        return _with_parameters(whole, find_class(registry, name, kind).Parameters)
    if kind == "emulator":
        return EmulatorConfig.model_json_schema()
    if kind in FAMILIES:
        return FAMILIES[kind][1].model_json_schema()
    return _with_parameters(ControllerConfig, find_controller(kind).Parameters)


def find_controller(kind: str) -> Any:
    """The class of a controller that stands where a kind of config may stand.

    Raises:
        UnknownNameError: nothing is called so; says so where it is a task's or a constraint's name.
        ConfigError: it cannot be imported, or is no controller.
    """
    if not (kind in controllers.registered() or ":" in kind):
        known = ["emulator", *FAMILIES, *controllers.registered()]
        hint = "".join(
            f" Did you mean: {family} {kind}?"
            for family, (registry, _) in FAMILIES.items()
            if kind in registry.registered()
        )
        raise UnknownNameError("kind of config", kind, known, hint)
    return find_class(controllers, kind, "controller")


def find_class(registry: Any, name: str, family: str) -> Any:
    """A class of a family; a dotted path may lead into the current folder, as into a config's.

    Raises:
        UnknownNameError: nothing is called so.
        ConfigError: it cannot be imported, or is something else.
    """
    here = str(Path.cwd())
    if ":" in name and here not in sys.path:
        sys.path.append(here)
    try:
        return registry.find(name, "the command line", family)
    except ConfigError as error:
        if error.problem.startswith("cannot be imported"):
            remedy = f"Install its package, or be in the folder of its module (this is {here})"
            raise ConfigError(error.file, error.key, name, error.problem, remedy) from error
        raise


def named() -> dict[str, list[str]]:
    """Everything that a config or a command can name, by what it is."""
    return {
        "robots": robots(),
        "controllers": sorted(controllers.registered()),
        "tasks": sorted(tasks.registered()),
        "curves": sorted(CURVES.registered()),
        "constraints": sorted(constraints.registered()),
        "emulator configs": emulator_configs(),
        "controller configs": controller_configs(),
    }


def _with_parameters(whole: type[Settings], own: type[Settings]) -> dict[str, Any]:
    """Schema of what names something, with that something's own parameters in their place."""
    schema, parameters = whole.model_json_schema(), own.model_json_schema()
    schema.setdefault("$defs", {}).update(parameters.pop("$defs", {}))
    schema["properties"]["parameters"] = parameters
    return schema


def _is_emulator(name: str) -> bool:
    if name in emulator_configs() or name in robots() or is_source(name):
        return True
    if name in controller_configs():
        return False
    if os.path.isdir(name):
        return True
    return os.path.isfile(name) and _has_keys_of_an_emulator(load_yaml(Path(name)))


def _has_keys_of_an_emulator(content: dict[str, Any]) -> bool:
    """Whose config a file is; a misspelt key speaks for the side that has the key most like it."""
    if "controller" in content:
        return False
    emulator, controller = (
        sum(likeness(key, tuple(model.model_fields)) for key in islice(content, SOME_KEYS))
        for model in (EmulatorConfig, ControllerConfig)
    )
    return emulator >= controller


SIDES: dict[str, type[Settings]] = {"emulator": EmulatorConfig, "controller": ControllerConfig}
REGISTRIES: dict[str, Any] = {
    **{kind: registry for kind, (registry, _) in FAMILIES.items()},
    "curve": CURVES,
}
"""What has parameters of its own, and the registry of its names."""

REQUIRED = "required"
_UNITS = {
    "_deg": "degrees",
    "_mb": "MB",
    "_m": "m",
    "_m_s": "m/s",
    "_m_s2": "m/s²",
    "_ms": "ms",
    "_n": "N",
    "_n_m": "N/m",
    "_n_s_m": "N s/m",
    "_per_s": "1/s",
    "_rad": "rad",
    "_rad_s": "rad/s",
    "_rad_s2": "rad/s²",
    "_s": "s",
    "_us": "µs",
}
_SUFFIX = re.compile("(" + "|".join(sorted(_UNITS, key=len, reverse=True)) + ")$")


class ConfigKey(NamedTuple):
    """One key: its dotted path, with N for the place in a list, and what may stand there.

    `changes` says whether it may be changed while the controller runs.
    """

    key: str
    type: str
    unit: str
    default: str
    meaning: str
    changes: bool = False

    def __str__(self) -> str:
        unit = f" [{self.unit}]" if self.unit else ""
        default = REQUIRED if self.default == REQUIRED else f"default {self.default}"
        changes = " (changes while it runs)" if self.changes else ""
        return f"{self.key}: {self.type}{unit}; {default}. {self.meaning}{changes}"


def config_keys(kind: str, name: str | None = None) -> list[ConfigKey]:
    """The keys of a side's config, or the parameters of something that a config names.

    Args:
        kind: "emulator", "controller", one of `REGISTRIES`, or a controller's name.
        name: of one of that family.

    Raises:
        UnknownNameError: nothing is called so.
        ConfigError: what is called so cannot be imported.
    """
    if name is None and kind in SIDES:
        return keys_of(SIDES[kind])
    if name is None:
        return keys_of(find_controller(kind).Parameters)
    if kind not in REGISTRIES:
        raise UnknownNameError("kind of config with names", kind, REGISTRIES)
    return keys_of(find_class(REGISTRIES[kind], name, kind).Parameters)


def keys_of(model: type[Settings]) -> list[ConfigKey]:
    """The keys of a model, in its order, each followed by those inside it."""
    schema = model.model_json_schema()
    defaults = {
        name: to_jsonable_python(field.get_default(call_default_factory=True))
        for name, field in model.model_fields.items()
        if not field.is_required()
    }
    return list(_Walk(schema.get("$defs", {})).mapping(schema, defaults, ""))


class _Walk:
    """Goes through a JSON Schema."""

    def __init__(self, definitions: Mapping[str, Any]) -> None:
        self._definitions = definitions

    def mapping(
        self, node: Mapping[str, Any], values: Mapping[str, Any], prefix: str
    ) -> Iterator[ConfigKey]:
        for name, inner in node.get("properties", {}).items():
            if "const" not in inner:  # a tag: it stands in the path
                yield from self._one(prefix + name, inner, values.get(name, REQUIRED))

    def _one(self, key: str, node: Mapping[str, Any], default: Any) -> Iterator[ConfigKey]:
        if "$ref" in node:
            whole = self._resolved(node)
            given = default if isinstance(default, dict) else _defaults(whole)
            yield from self.mapping(whole, given, f"{key}.")
            return
        suffix = _SUFFIX.search(key)
        unit = _UNITS[suffix[0]] if suffix else ""
        meaning = node.get("description", "").removesuffix(f" [{unit}]")
        changes = node.get("changeable") is True
        yield ConfigKey(key, _type(node), unit, _shown(default), meaning, changes)
        for option in node.get("anyOf", [node]):
            yield from self._inside(key, option)

    def _inside(self, key: str, node: Mapping[str, Any]) -> Iterator[ConfigKey]:
        """Keys of the mappings in a list, or of each kind of mapping that may stand there."""
        if isinstance(node.get("items"), dict):
            node, key = node["items"], f"{key}.N"
        tag = node.get("discriminator", {}).get("propertyName")
        for one in node["oneOf"] if tag else [node] if "$ref" in node else []:
            whole = self._resolved(one)
            path = f"{key}({whole['properties'][tag]['const']})" if tag else key
            yield from self.mapping(whole, _defaults(whole), f"{path}.")

    def _resolved(self, node: Mapping[str, Any]) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self._definitions[node["$ref"].rpartition("/")[2]]
        return found


def _defaults(node: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: inner["default"]
        for name, inner in node.get("properties", {}).items()
        if "default" in inner
    }


def _shown(default: Any) -> str:
    """A default as it would be written in a config."""
    if default == REQUIRED:
        return REQUIRED
    if isinstance(default, str | bool) or default is None:
        return json.dumps(default).strip('"')
    text: str = yaml.safe_dump(default, default_flow_style=True, sort_keys=False, width=10_000)
    return text.removesuffix("...\n").strip()


def _type(node: Mapping[str, Any]) -> str:
    if "anyOf" in node:
        *most, last = [_type(each) for each in node["anyOf"]]
        return f"{', '.join(most)}, or {last}"
    if "enum" in node or "const" in node:
        return ", ".join(str(value) for value in node.get("enum", [node.get("const")]))
    if "discriminator" in node:
        return f"mapping with {node['discriminator']['propertyName']}"
    if "$ref" in node:
        return "mapping"
    kind = node.get("type")
    if kind in {"integer", "number"}:
        return f"{kind}{_range(node)}"
    if kind == "string":
        return f"text {node['pattern']}" if "pattern" in node else "text"
    if kind == "array":
        return _list_type(node)
    if isinstance(node.get("additionalProperties"), dict):
        return f"mapping to {_type(node['additionalProperties'])}"
    return {"boolean": "true or false", "null": "null"}.get(str(kind), "mapping")


def _list_type(node: Mapping[str, Any]) -> str:
    parts = [_type(part) for part in node.get("prefixItems", [])]
    if not parts:
        return f"list of {_type(node['items'])}"
    if len(set(parts)) > 1:
        return f"list of {'; '.join(parts)}"
    return f"list of {len(parts)} × {parts[0]}"


def _range(node: Mapping[str, Any]) -> str:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    found = [f"{sign} {node[name]:g}" for name, sign in signs.items() if name in node]
    return f" {', '.join(found)}" if found else ""
