"""The tables of docs/configuration.md are the models: keys, types, units and defaults."""

from __future__ import annotations

import re
from typing import Any, get_args

import pytest
import yaml
from pages import page, table
from pydantic_core import to_jsonable_python

from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.config import CONFIGS, ControllerConfig
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.constraints.collision.collision_geometry import AnyObstacle
from hoap3.remote_controller.controllers.acceleration.ghc import GhcController
from hoap3.remote_controller.controllers.acceleration.hqp import HqpController
from hoap3.remote_controller.controllers.acceleration.joint_acceleration import (
    JointAccelerationController,
)
from hoap3.remote_controller.controllers.acceleration.tsid import TsidController
from hoap3.remote_controller.controllers.acceleration.weighted import WeightedController
from hoap3.remote_controller.controllers.acceleration_tasks.settings import AnyTask
from hoap3.remote_controller.controllers.lyapunov_qp.settings import Objective
from hoap3.remote_controller.controllers.lyapunov_qp.stable_qp import StableQpController
from hoap3.remote_controller.controllers.qp12.osqp import OsqpController
from hoap3.remote_controller.controllers.qp12.pinv import PinvController
from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller
from hoap3.remote_controller.controllers.velocity.clik import ClikController, ClikSdpController
from hoap3.remote_controller.controllers.velocity.ghc_velocity import GhcVelocityController
from hoap3.remote_controller.references.settings import TargetSettings
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.remote_controller.tasks.curve_following.curve import CURVES
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load

MODELS: dict[str, type[Settings]] = {
    "Keys of the emulator": EmulatorConfig,
    "Keys of the controller": ControllerConfig,
    "Parameters of qp12": Qp12Controller.Parameters,
    "Parameters of pinv": PinvController.Parameters,
    "Parameters of osqp": OsqpController.Parameters,
    "Parameters of stable_qp": StableQpController.Parameters,
    "Parameters of joint_acceleration": JointAccelerationController.Parameters,
    "Parameters of tsid": TsidController.Parameters,
    "Parameters of ghc_velocity": GhcVelocityController.Parameters,
    "Parameters of clik": ClikController.Parameters,
    "Parameters of clik_sdp": ClikSdpController.Parameters,
    "Parameters of ghc": GhcController.Parameters,
    "Parameters of hqp": HqpController.Parameters,
    "Parameters of weighted": WeightedController.Parameters,
}


def union(annotated: Any, tag: str) -> dict[str, type[Settings]]:
    """Models of a discriminated union, by the value of its tag."""
    models = get_args(get_args(annotated)[0])
    return {get_args(model.model_fields[tag].annotation)[0]: model for model in models}


GROUPS: dict[str, dict[str, type[Settings]]] = {
    "Objectives": union(Objective, "kind"),
    "Tasks of hierarchies": union(AnyTask, "kind"),
    "Tasks and constraints": {
        "task": tasks.TaskSettings,
        "constraint": constraints.ConstraintSettings,
    },
    "Parameters of tasks": {name: tasks.find(name).Parameters for name in tasks.BUILTIN},
    "Parameters of targets": union(TargetSettings, "kind"),
    "Parameters of curves": {
        name: CURVES.find(name, "config", "curve").Parameters for name in CURVES.builtin
    },
    "Parameters of constraints": {
        name: constraints.find(name).Parameters for name in constraints.BUILTIN
    },
    "Obstacles": union(AnyObstacle, "shape"),
}
"""Tables whose first column names whose key it is: one or more of these."""
TAGS = {
    "Objectives": "kind",
    "Tasks of hierarchies": "kind",
    "Parameters of targets": "kind",
    "Obstacles": "shape",
}
UNITS = {
    "_n": "N",
    "_n_m": "N/m",
    "_n_s_m": "N s/m",
    "_ms": "ms",
    "_us": "µs",
    "_mb": "MB",
    "_rad_s": "rad/s",
    "_rad_s2": "rad/s²",
    "_m_s": "m/s",
    "_m_s2": "m/s²",
    "_per_s": "1/s",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
}
SUFFIX = re.compile("(" + "|".join(sorted(UNITS, key=len, reverse=True)) + ")$")
SUPERSCRIPT = {2**63 - 1: "2⁶³ − 1"}


def flat(schema: dict[str, Any], defaults: dict[str, Any]) -> dict[str, tuple[str, Any]]:
    """Dotted key → type in words, default; "required" where there is none."""
    found: dict[str, tuple[str, Any]] = {}

    def descend(node: dict[str, Any], values: dict[str, Any], prefix: str) -> None:
        for name, inner in node["properties"].items():
            reference = inner.get("$ref")
            if reference is not None:
                whole = schema["$defs"][reference.split("/")[-1]]
                descend(whole, values.get(name, given(whole)), f"{prefix}{name}.")
                continue
            found[prefix + name] = (in_words(inner), values.get(name, "required"))
            options = inner.get("anyOf", [inner])
            for of_each in [option.get("items", {}).get("$ref") for option in options]:
                if of_each is None:
                    continue
                each = schema["$defs"][of_each.split("/")[-1]]
                descend(each, given(each), f"{prefix}{name}.N.")

    def given(node: dict[str, Any]) -> dict[str, Any]:
        return {k: v["default"] for k, v in node["properties"].items() if "default" in v}

    descend(schema, defaults, "")
    return found


def in_words(node: dict[str, Any]) -> str:
    """A type as the tables write it."""
    if "anyOf" in node:
        *most, last = [in_words(each) for each in node["anyOf"]]
        return f"{', '.join(most)}, or {last}"
    if "enum" in node or "const" in node:
        return ", ".join(f"`{value}`" for value in node.get("enum", [node.get("const")]))
    if "discriminator" in node:
        return f"mapping with `{node['discriminator']['propertyName']}`"
    if "$ref" in node:
        return "mapping"
    kind = node["type"]
    if kind in {"integer", "number"}:
        return kind + limits(node)
    if kind == "string":
        return "text" + (f" `{node['pattern']}`" if "pattern" in node else "")
    if kind == "array":
        if "prefixItems" in node:
            each = [in_words(part) for part in node["prefixItems"]]
            if len(set(each)) > 1:
                return f"list of {'; '.join(each)}"
            what, *rest = each[0].split(" ")
            return " ".join(["list of", str(len(node["prefixItems"])), f"{what}s", *rest])
        return f"list of {in_words(node['items'])}"
    if isinstance(node.get("additionalProperties"), dict):
        return f"mapping to {in_words(node['additionalProperties'])}"
    return {"boolean": "true or false", "null": "null", "object": "mapping"}[kind]


def limits(node: dict[str, Any]) -> str:
    """Range of a number."""
    least, most = node.get("minimum"), node.get("maximum")
    if "exclusiveMinimum" in node:
        above = f" > {node['exclusiveMinimum']:g}"
        return above if most is None else f"{above}, at most {most:g}"
    if "exclusiveMaximum" in node and node["type"] == "number":
        return f", {least:g} to below {node['exclusiveMaximum']:g}"
    if most is None and "exclusiveMaximum" in node:
        most = node["exclusiveMaximum"] - 1
    if most is None:
        return "" if least is None else f" ≥ {least:g}"
    return f", {least:g} to {SUPERSCRIPT.get(most) or format(most, 'g')}"


def keys(model: type[Settings]) -> dict[str, tuple[str, Any]]:
    """Dotted key → type in words and default of every setting of a model."""
    defaults = {
        name: to_jsonable_python(field.get_default(call_default_factory=True))
        for name, field in model.model_fields.items()
        if not field.is_required()
    }
    return flat(model.model_json_schema(), defaults)


def models() -> list[tuple[str, str, str, str, Any]]:
    """Heading, whose, key, type and default of every setting; whose is "" where all have one."""
    rows = [
        (heading, "", key, *about)
        for heading, model in MODELS.items()
        for key, about in keys(model).items()
    ]
    return rows + [
        (heading, name, key, *about)
        for heading, group in GROUPS.items()
        for name, model in group.items()
        for key, about in keys(model).items()
        if key != TAGS.get(heading)
    ]


def written(heading: str) -> list[tuple[str, str, dict[str, str]]]:
    """Whose, key, and the whole of each row; a row that several share counts for each."""
    rows = table("configuration.md", heading)
    if heading in MODELS:
        return [("", row["key"].strip("`"), row) for row in rows]
    return [
        (name.strip("` "), row["key"].strip("`"), row)
        for row in rows
        for name in next(iter(row.values())).split(",")
    ]


@pytest.mark.parametrize("heading", [*MODELS, *GROUPS])
def test_a_table_has_every_key_and_no_other(heading):
    found = sorted((name, key) for name, key, _ in written(heading))
    assert found == sorted((name, key) for where, name, key, *_ in models() if where == heading)


@pytest.mark.parametrize(("heading", "name", "key", "kind", "default"), models())
def test_a_row_is_as_the_model_has_it(heading, name, key, kind, default):
    (row,) = [row for whose, which, row in written(heading) if (whose, which) == (name, key)]
    assert row["type"] == kind
    given = row["default"].strip("`")
    assert (default if default == "required" else yaml.safe_load(given)) == default
    assert given == "required" or default != "required"
    assert len(row["meaning"]) > 5
    suffix = SUFFIX.search(key)
    if suffix:
        assert row["unit"] == UNITS[suffix[0]]


@pytest.mark.parametrize("heading", GROUPS)
def test_everything_that_a_table_is_about_stands_before_it(heading):
    """Also what has no key of its own."""
    _, _, rest = page("configuration.md").partition(f"# {heading}\n")
    text = rest.partition("\n#")[0]
    for name in GROUPS[heading]:
        assert f"`{name}`" in text


def test_the_papers_config_says_nothing_but_what_hoap3_does_by_default():
    content = yaml.safe_load((CONFIGS / "qp12_paper.yaml").read_text(encoding="utf-8"))
    robot = load("hoap3")
    written_out, by_default = (
        Qp12Controller(robot, Qp12Controller.Parameters(**parameters)).parameters
        for parameters in (content["parameters"], {})
    )
    assert written_out == by_default
