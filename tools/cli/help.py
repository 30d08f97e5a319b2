"""`hoap3 --help` with its commands in groups, and `hoap3 help`: pages of the documentation."""

from __future__ import annotations

from importlib.resources import files
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from hoap3.protocol.errors import UnknownNameError
from hoap3.tools.analysis.output import print_line
from hoap3.tools.machine.processes import SERVICE_MB

GROUPS = {
    "Run a robot and its controller": ("run", "emulator", "controller", "list"),
    "Act on a running robot": ("status", "stop", "recover", "release", "change", "view", "bridge"),
    "Use a log": ("report", "verify", "replay", "export", "record"),
    "Prepare robots, settings and code": ("robot", "config", "trajectory", "limits", "new"),
    "Measure": ("compare", "doctor", "latency", "bench", "soak", "reproduce"),
    "Operate": ("service", "certs", "help"),
}
LIGHT = "status", "stop", "recover", "release", "list", "certs", "service", "help"
NEEDED_MB = dict.fromkeys(LIGHT, 160) | dict.fromkeys(("emulator", "controller"), SERVICE_MB)
"""Address space, where it is not that of most commands."""


class GroupedCommands(TyperGroup):
    """The commands in the order of `GROUPS`."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; what is wrong with an option is said without pydantic's terms."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Input ").partition(", unable")[0]
            raise

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write a section for each group."""
        width = formatter.width - 16
        for title, names in GROUPS.items():
            found = {name: self.commands[name].get_short_help_str(width) for name in names}
            with formatter.section(title):
                formatter.write_dl([(f"{name:10}", text) for name, text in found.items()])


def show_help(
    topic: Annotated[
        str | None, typer.Argument(help="Name of the page; default: list all.")
    ] = None,
) -> None:
    """Print a page of the documentation."""
    folders = [each for each in files("hoap3").joinpath("docs").iterdir() if each.is_dir()]
    found = (each for folder in folders for each in folder.iterdir())
    pages = {each.name[:-3]: each for each in found if each.name.endswith(".md")}
    if topic is None:
        print_line("\n".join(sorted(pages)))
    elif topic in pages:
        print_line(pages[topic].read_text(encoding="utf-8").rstrip("\n"))
    else:
        raise UnknownNameError("topic", topic, pages, " For a command: `hoap3 COMMAND --help`")
