"""The two streams of a command: results on standard output; notes and progress on standard error.

A reader that goes away, such as `head`, is no error: the command ends as it would have.
"""

from __future__ import annotations

import json
import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any, Literal, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.machine.processes import printable, to_people

REFRESH_S = 0.1  # of a bar on a terminal
FIRST_LINE_S = 2.0  # where there is no terminal: when the first line of progress is written
NEXT_LINE_S = 10.0  # and how long after it the next one
QUIET_S = 60.0  # between two lines about bad connections
COMPILING = "compiling kernels, once for each version"
WIDE = 1000  # columns where there is no terminal: a row of a table stays one line


class _Stream:
    """A standard stream, whatever it is redirected to now.

    What cannot be written on standard error is dropped: no command depends on who reads its notes.
    """

    def __init__(self, name: Literal["stdout", "stderr"]) -> None:
        self._name = name

    @property
    def encoding(self) -> str:
        """Of the text."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        stream = self._stream
        return stream is not None and not stream.closed and stream.isatty()

    def fileno(self) -> int:
        """Its file descriptor."""
        if self._stream is None:
            raise OSError(f"{self._name} is closed")
        return self._stream.fileno()

    def write(self, text: str) -> None:
        """Write text, on a terminal with the blanks that fill the cells of tables.

        Raises:
            Hoap3Error: standard output cannot be written, and not because its reader went away.
        """
        stream = self._stream
        if stream is None:
            return
        try:
            stream.write(text if self.isatty() else re.sub(r" +$", "", text, flags=re.MULTILINE))
            stream.flush()
        except OSError as error:
            with suppress(OSError, ValueError):  # it has no file descriptor, as in a test
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())  # or the interpreter fails again at its end
                os.close(nowhere)
            if self._name == "stdout" and not isinstance(error, BrokenPipeError):
                reason = error.strerror or "no reason given"
                raise Hoap3Error(f"standard output cannot be written ({reason})") from error

    def flush(self) -> None:
        """Nothing to do: each `write` flushes."""

    @property
    def _stream(self) -> TextIO | None:
        stream: TextIO | None = getattr(sys, self._name)
        below: TextIO | None = getattr(stream, "rich_proxied_file", stream)  # of a bar
        return below


class PrintableConsole(Console):
    """A console that escapes control characters in every string it is given, also in tables.

    A cell that is wider than its column continues in the next line; rich would cut it.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, with tables whose cells are whole."""
        for table in objects:
            for column in table.columns if isinstance(table, Table) else ():
                column.overflow = "fold"
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """A string as styled text."""
        return super().render_str(printable(text), **options)


def _console(name: Literal["stdout", "stderr"]) -> Console:
    stream: Any = _Stream(name)
    console = PrintableConsole(file=stream, highlight=False, emoji=False)
    if not console.is_terminal:
        console = PrintableConsole(file=stream, highlight=False, emoji=False, width=WIDE)
    return console


results, notes = _console("stdout"), _console("stderr")


def print_line(text: str) -> None:
    """A result of one line, or some: no markup, no wrapping."""
    _Stream("stdout").write(printable(text) + "\n")


def print_note(text: str) -> None:
    """A note of one line, as it is."""
    notes.print(text, style="dim", markup=False, soft_wrap=True)


def print_json(content: Any) -> None:
    """The result as one JSON object."""
    _Stream("stdout").write(json.dumps(content, indent=2) + "\n")


def print_result(content: Any, lines: str | Iterable[str], *, as_json: bool) -> None:
    """Print a result as one JSON object, or as lines for people."""
    if as_json:
        print_json(content)
        return
    for line in [lines] if isinstance(lines, str) else lines:
        print_line(line)


class _BadConnections(logging.Handler):
    """Counts records, and reports them at most once in `QUIET_S`."""

    count, due = 0, 0.0

    def emit(self, record: logging.LogRecord) -> None:
        """Count a connection."""
        self.count += 1
        if (now := time.monotonic()) >= self.due:
            self.due = now + QUIET_S
            why = (record.exc_info and record.exc_info[1]) or record.getMessage()
            to_people(f"{record.name}: {self.count} bad connections so far, the last: {why!s:.99}")


def bad_connections(where: str) -> logging.Logger:
    """What logs connections that are not understood; `where` is what listens."""
    logger = logging.Logger(where, logging.WARNING)
    logger.addHandler(_BadConnections())
    return logger


class Meter:
    """Progress on standard error.

    On a terminal it is one line that is replaced; elsewhere a line after 2 s, and then at most one
    every 10 s. It has no thread, which would disturb what is measured meanwhile: it moves when it
    is told something.

    Args:
        title: what is being done.
        bar: on a terminal.
    """

    def __init__(self, title: str, bar: Progress | None) -> None:
        self._title, self._bar = title, bar
        self._task = bar.add_task(title, total=None) if bar else None
        self._shown = time.monotonic() - REFRESH_S
        self._next_line = time.monotonic() + FIRST_LINE_S

    def part(self, done: int, whole: int) -> None:
        """How much is done, and of how much."""
        now = time.monotonic()
        if self._bar is None:
            self._line(now, f"{100 * done // max(whole, 1)} %")
        elif now - self._shown >= REFRESH_S or done >= whole:
            self._update(now, completed=done, total=whole)

    def step(self, what: str) -> None:
        """What is being done now."""
        now = time.monotonic()
        if self._bar is None:
            self._line(now, what)
        else:
            self._update(now, description=f"{self._title}: {what}")

    def _update(self, now: float, **what: Any) -> None:
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, **what)
            self._bar.refresh()
            self._shown = now

    def _line(self, now: float, text: str) -> None:
        if now >= self._next_line:
            self._next_line = now + NEXT_LINE_S
            print_note(f"{self._title}: {text}")


class CompilationMeter(Meter):
    """Counts the kernels that are compiled. How many there will be depends on what is imported."""

    def __init__(self) -> None:
        super().__init__(COMPILING, None)
        self._count = 0

    def text(self, kernel: str) -> str:
        """Count a kernel, and return the line about it without the title."""
        self._count += 1
        return f"number {self._count}, {kernel}"

    def step(self, what: str) -> None:
        """Count a kernel, and show it."""
        super().step(self.text(what))


@contextmanager
def progress(title: str) -> Iterator[Meter]:
    """Show how far something is; see `Meter`."""
    if not watched():
        yield Meter(title, None)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),  # empty where nobody knows how much there is
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=notes, transient=True, auto_refresh=False, redirect_stdout=False
    ) as bar:
        yield Meter(title, bar)


def watched() -> bool:
    """Whether standard error is a terminal on which a line can be replaced."""
    return notes.is_terminal and not notes.is_dumb_terminal


@cache
def watch_compilation(tell: Callable[[str], None] | None = None) -> None:
    """Have it told which kernel is compiled next; one that comes from the cache is not.

    Args:
        tell: takes its name; None: lines on standard error, the first after 2 s.
    """
    from numba.core import event  # it takes a second

    say = tell or CompilationMeter().step

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            say(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:
            """Nothing is told of an end."""

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
