"""Commands that draw, on a machine without what draws: they say so before they do anything."""

from __future__ import annotations

import sys

import pytest
from typer.testing import CliRunner

from hoap3.protocol.errors import NotInstalledError
from hoap3.tools.cli.app import app

COMMANDS = {
    "report": ("report", "LOG"),
    "compare": ("compare", "qp12", "pinv", "--out", "FOLDER"),
    "reproduce": ("reproduce", "qp12", "--out", "FOLDER"),
}


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_that_draws_names_the_extra_and_begins_nothing(
    command, package, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    found = CliRunner().invoke(app, COMMANDS[command])
    assert isinstance(found.exception, NotInstalledError)
    assert "hoap3[report]" in str(found.exception)
    assert not list(tmp_path.iterdir())
