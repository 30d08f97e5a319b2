"""`hoap3 config keys`: every key of every model is told, as the model has it."""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest
import yaml
from pydantic_core import to_jsonable_python

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.tools.services.settings import REGISTRIES, REQUIRED, SIDES, config_keys, keys_of

NAMED = [
    (kind, name) for kind, family in REGISTRIES.items() for name in sorted(family.registered())
]
TOPICS = [*((side, None) for side in SIDES), *NAMED]


def model_of(kind: str, name: str | None) -> type[Settings]:
    return SIDES[kind] if name is None else REGISTRIES[kind].find(name, "test", kind).Parameters


@pytest.mark.parametrize(("kind", "name"), TOPICS)
def test_every_key_of_a_model_is_told_with_its_meaning(kind, name):
    told = config_keys(kind, name)
    fields = model_of(kind, name).model_fields
    assert list(dict.fromkeys(re.split(r"[.(]", each.key)[0] for each in told)) == list(fields)
    assert all(each.meaning and each.type for each in told)
    assert len({each.key for each in told}) == len(told)


@pytest.mark.parametrize(("kind", "name"), TOPICS)
def test_the_defaults_that_are_told_are_those_of_the_model(kind, name):
    model = model_of(kind, name)
    defaults = {
        key: field.get_default(call_default_factory=True)
        for key, field in model.model_fields.items()
        if not field.is_required()
    }
    present = to_jsonable_python(defaults)
    for each in config_keys(kind, name):
        if not (".N" in each.key or "(" in each.key):
            place: Any = present
            for step in each.key.split("."):
                place = place.get(step, REQUIRED) if place else REQUIRED
            told = each.default
            assert place in (REQUIRED, yaml.safe_load(told))
            assert (told == REQUIRED) <= (place == REQUIRED)


class Inner(Settings):
    length_m: float = 1.5


class Outer(Settings):
    inner: Inner = Inner(length_m=2.5)
    several: tuple[Inner, ...] = ()


def test_keys_inside_mappings_and_lists_follow_with_their_defaults():
    told = {each.key: each for each in keys_of(Outer)}
    assert list(told) == ["inner.length_m", "several", "several.N.length_m"]
    assert (told["inner.length_m"].default, told["inner.length_m"].unit) == ("2.5", "m")
    assert told["several.N.length_m"].default == "1.5"


def test_what_nobody_registered_is_refused_by_name():
    with pytest.raises(UnknownNameError, match="qp12"):
        config_keys("qp13")
    with pytest.raises(UnknownNameError, match="constraint distance"):
        config_keys("distance")
    with pytest.raises(UnknownNameError):
        config_keys("robot", "ur5")
    with pytest.raises(ConfigError):
        config_keys("no_such_module:Class")


def test_a_controller_of_ones_own_in_the_current_folder_is_found(tmp_path, monkeypatch):
    (tmp_path / "own_keys.py").write_text(
        "from pydantic import Field\n"
        "from hoap3 import VelocityController\n"
        "class Own(VelocityController):\n"
        "    class Parameters(VelocityController.Parameters):\n"
        "        gain_per_s: float = Field(2.0, description='of the error')\n"
        "    def velocity(self, state):\n"
        "        return state.dq\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    told = {each.key: each for each in config_keys("own_keys:Own")}
    assert (told["gain_per_s"].default, told["gain_per_s"].unit) == ("2.0", "1/s")
