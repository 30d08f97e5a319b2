"""Plays a page from top to bottom in an empty folder, as a reader would."""

from __future__ import annotations

import contextlib
import importlib
import io
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

from pages import Block, blocks

from hoap3.tools.analysis.compare.candidates import read_candidates
from hoap3.tools.cli.app import command_line, main
from hoap3.tools.cli.options import with_secure
from hoap3.tools.services import configs

_ASSIGNMENT = re.compile(r"PYTHONPATH=(\S+)")


class Story:
    """A folder, and what was printed last.

    Everything happens in this process, but each command finds what a new one would: an import path
    without the folder, and none of its modules loaded.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._printed = ""
        self._names: dict[str, object] = {"__name__": "__main__"}

    def play(self, block: Block) -> None:
        """Do what a block says."""
        if block.word == "file":
            self._write(block)
        elif block.word == "prints":
            missing = [line for line in block.text.splitlines() if line not in self._printed]
            assert not missing, f"{missing} is not in\n{self._printed}"
        elif block.word == "parsed only":
            with self._fresh():
                for command in block.commands:
                    check(command)
        elif block.language == "sh" and block.word != "not run":
            codes = [int(code) for code in block.rest.split(",")] if block.word == "exits" else [0]
            if len(codes) == 1:  # the same of each command
                codes *= len(block.commands)
            self._printed = ""
            for command, expected in zip(block.commands, codes, strict=True):
                code = self._run(command)
                assert code == expected, f"{command}\nended with {code}\n{self._printed}"
        elif block.language == "python" and block.word != "not run":
            with self._fresh(str(self._folder)), self._listening():
                exec(compile(block.text, f"line {block.line}", "exec"), self._names)

    def write_files(self, name: str) -> None:
        """Write the files of a page."""
        for block in blocks(name):
            if block.word == "file":
                self._write(block)

    def _write(self, block: Block) -> None:
        path = self._folder / block.rest
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")

    def _run(self, command: str) -> int:
        words = shlex.split(command, comments=True)
        paths: list[str] = []
        while match := _ASSIGNMENT.fullmatch(words[0]):
            paths.append(str(self._folder / match[1]))
            words = words[1:]
        if words[0] != "hoap3":
            return subprocess.run(["bash", "-ec", command], check=False).returncode
        with self._fresh(*paths), self._listening():
            return hoap3(words)

    @contextlib.contextmanager
    def _fresh(self, *paths: str) -> Iterator[None]:
        before = list(sys.path)
        sys.path.extend(paths)
        importlib.invalidate_caches()
        try:
            yield
        finally:
            sys.path[:] = before
            for name, module in list(sys.modules.items()):
                if str(getattr(module, "__file__", None)).startswith(str(self._folder)):
                    del sys.modules[name]

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        heard = io.StringIO()
        with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
            try:
                yield
            finally:
                self._printed += heard.getvalue()


def hoap3(words: list[str]) -> int:
    """Run `hoap3 …` in this process; its exit code."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with patch.object(sys, "argv", words):
            main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0


def check(command: str) -> None:
    """Parse `hoap3 …` as the command line would, and check the settings that it names.

    Raises:
        click.UsageError, Hoap3Error: it would be refused.
    """
    words = shlex.split(command, comments=True)
    assert words[0] == "hoap3", command
    parser, name, rest = command_line(), "hoap3", words[1:]
    while hasattr(parser, "commands") and rest and not rest[0].startswith("-"):
        assert rest[0] in parser.commands, f"{command}: no command {rest[0]!r}"
        parser, name, rest = parser.commands[rest[0]], rest[0], rest[1:]
    if rest in (["--help"], ["--version"]):
        return
    values = parser.make_context(name, rest).params
    sets, open_ = values.get("sets") or [], values.get("insecure", False)
    sets = with_secure(sets, values.get("secure"), insecure=open_)
    if name == "run":
        ours, theirs = configs.split_overrides(sets)
        law, _ = configs.load_controller_config(values["controller"], theirs)
        configs.load_emulator_config(values["robot"] or law.robot, ours)
    elif name == "emulator":
        configs.load_emulator_config(values["config"], sets)
    elif name == "controller":
        configs.load_controller_config(values["config"], sets)
    elif name == "compare":
        read_candidates(values["controllers"])


def subcommands() -> Iterator[str]:
    """Every command of `hoap3`, such as `config show`."""

    def below(parser: object, path: str) -> Iterator[str]:
        for name, inner in getattr(parser, "commands", {}).items():
            if hasattr(inner, "commands"):
                yield from below(inner, f"{path}{name} ")
            else:
                yield path + name

    return below(command_line(), "")
