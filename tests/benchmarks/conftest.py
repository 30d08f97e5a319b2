"""Runs the command line of a benchmark in this process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result


@pytest.fixture
def run_command() -> Callable[..., Result]:
    """Call it with a benchmark's `command` and its words."""

    def run(command: Callable[..., Any], *words: object) -> Result:
        app = typer.Typer()
        app.command()(command)
        return CliRunner().invoke(app, [str(word) for word in words])

    return run
