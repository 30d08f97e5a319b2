"""The tables of docs/configuration.md are the models: keys, types, units and defaults."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml
from pages import table

from protocol.settings import Settings
from remote_controller.config import CONFIGS, ControllerConfig
from remote_controller.controllers.osqp import OsqpController
from remote_controller.controllers.pinv import PinvController
from remote_controller.controllers.qp12 import Qp12Controller
from robot_emulator.config import EmulatorConfig

MODELS: dict[str, type[Settings]] = {
    "Keys of the emulator": EmulatorConfig,
    "Keys of the controller": ControllerConfig,
    "Parameters of qp12": Qp12Controller.Parameters,
    "Parameters of pinv": PinvController.Parameters,
    "Parameters of osqp": OsqpController.Parameters,
}
UNITS = {"_ms": "ms", "_us": "µs", "_mb": "MB", "_rad_s": "rad/s", "_per_s": "1/s", "_m": "m"}
SUPERSCRIPT = {2**63 - 1: "2⁶³ − 1"}


def flat(schema: dict[str, Any], defaults: dict[str, Any]) -> dict[str, tuple[str, Any]]:
    """Dotted key → type in words, default; "required" where there is none."""
    found: dict[str, tuple[str, Any]] = {}

    def descend(node: dict[str, Any], values: dict[str, Any], prefix: str) -> None:
        for name, inner in node["properties"].items():
            reference = inner.get("$ref")
            if reference is not None:
                descend(schema["$defs"][reference.split("/")[-1]], values[name], f"{prefix}{name}.")
            else:
                found[prefix + name] = (in_words(inner), values.get(name, "required"))

    descend(schema, defaults, "")
    return found


def in_words(node: dict[str, Any]) -> str:
    """A type as the tables write it."""
    if "anyOf" in node:
        *most, last = [in_words(each) for each in node["anyOf"]]
        return f"{', '.join(most)}, or {last}"
    if "enum" in node or "const" in node:
        return ", ".join(f"`{value}`" for value in node.get("enum", [node.get("const")]))
    kind = node["type"]
    if kind in {"integer", "number"}:
        return kind + limits(node)
    if kind == "string":
        return "text" + (f" `{node['pattern']}`" if "pattern" in node else "")
    if kind == "array":
        if "prefixItems" in node:
            return f"list of {len(node['prefixItems'])} {in_words(node['prefixItems'][0])}s"
        return f"list of {in_words(node['items'])}"
    return {"boolean": "true or false", "null": "null", "object": "mapping"}[kind]


def limits(node: dict[str, Any]) -> str:
    """Range of a number."""
    if "exclusiveMinimum" in node:
        return f" > {node['exclusiveMinimum']:g}"
    least, most = node.get("minimum"), node.get("maximum")
    if most is None and "exclusiveMaximum" in node:
        most = node["exclusiveMaximum"] - 1
    if most is None:
        return "" if least is None else f" ≥ {least:g}"
    return f", {least:g} to {SUPERSCRIPT.get(most) or format(most, 'g')}"


def models() -> list[tuple[str, str, str, Any]]:
    """Heading, key, type and default of every setting."""
    rows = []
    for heading, model in MODELS.items():
        needed = {name: "x" for name, f in model.model_fields.items() if f.is_required()}
        defaults = model(**needed).model_dump(mode="json")
        for name in needed:
            del defaults[name]
        for key, (kind, default) in flat(model.model_json_schema(), defaults).items():
            rows.append((heading, key, kind, default))
    return rows


@pytest.mark.parametrize("heading", MODELS)
def test_a_table_has_every_key_and_no_other(heading):
    written = [row["key"].strip("`") for row in table("configuration.md", heading)]
    assert sorted(written) == sorted(key for where, key, _, _ in models() if where == heading)


@pytest.mark.parametrize(("heading", "key", "kind", "default"), models())
def test_a_row_is_as_the_model_has_it(heading, key, kind, default):
    (row,) = [r for r in table("configuration.md", heading) if r["key"] == f"`{key}`"]
    assert row["type"] == kind
    written = row["default"].strip("`")
    assert (default if default == "required" else yaml.safe_load(written)) == default
    assert written == "required" or default != "required"
    assert len(row["meaning"]) > 5
    suffix = re.search(r"_(ms|us|mb|rad_s|per_s|m)$", key)
    if suffix:
        assert row["unit"] == UNITS[suffix[0]]


@pytest.mark.parametrize(("name", "law"), [("qp12", Qp12Controller), ("osqp", OsqpController)])
def test_a_shipped_config_says_nothing_but_defaults(name, law):
    content = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"))
    assert law.Parameters(**content["parameters"]) == law.Parameters()
