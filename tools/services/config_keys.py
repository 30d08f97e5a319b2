"""Every key of a config as a table: type, unit, default and meaning, taken from the models."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import yaml
from pydantic_core import to_jsonable_python

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import UnknownNameError
from hoap3.remote_controller.config import ControllerConfig
from hoap3.remote_controller.tasks.curve_following.curve import CURVES
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.services import settings

SIDES: dict[str, type[Settings]] = {"emulator": EmulatorConfig, "controller": ControllerConfig}
FAMILIES: dict[str, Any] = {
    **{kind: registry for kind, (registry, _) in settings.FAMILIES.items()},
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
        kind: "emulator", "controller", one of `FAMILIES`, or a controller's name.
        name: of one of that family.

    Raises:
        UnknownNameError: nothing is called so.
        ConfigError: what is called so cannot be imported.
    """
    if name is None and kind in SIDES:
        return keys_of(SIDES[kind])
    if name is None:
        return keys_of(settings.find_controller(kind).Parameters)
    if kind not in FAMILIES:
        raise UnknownNameError("kind of config with names", kind, FAMILIES)
    return keys_of(settings.find_class(FAMILIES[kind], name, kind).Parameters)


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
