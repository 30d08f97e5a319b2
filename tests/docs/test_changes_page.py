"""The page of changes names what may change: no more, and no less."""

from __future__ import annotations

import re

import pytest
from pages import page

from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.registry import BUILTIN
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.tools.services.config_keys import config_keys


def table(head: str) -> dict[str, set[str]]:
    """Keys by each name of the first cell, in the table of that head."""
    text = page("changes.md").split(f"| {head} | |")[1].split("\n\n")[0]
    found: dict[str, set[str]] = {}
    for names, keys in re.findall(r"^\| (`.*?) \| (.*) \|$", text, flags=re.MULTILINE):
        for name in re.findall(r"`(\w+)`", names):
            found[name] = set(re.findall(r"`([\w.]+)`", keys))
    return found


def changing(kind: str, name: str | None = None) -> set[str]:
    """What the settings say, in the words of the page."""
    keys = (each.key for each in config_keys(kind, name) if each.changes)
    return {re.sub(r"\(\w+\)", "", key).replace(".N.", ".NAME.") for key in keys}


@pytest.mark.parametrize("name", BUILTIN)
def test_the_numbers_of_a_controller_are_named(name):
    assert table("controller")[name] == changing(name)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *(("task", name) for name in tasks.BUILTIN),
        *(("constraint", name) for name in constraints.BUILTIN),
    ],
)
def test_the_numbers_of_a_task_or_a_constraint_are_named(kind, name):
    wanted = changing(kind, name) - ({"weights"} if name == "wrench" else set())
    assert table("task or constraint").get(name, set()) == wanted
