"""Progress on standard error: where it goes, how often, and that it disturbs no measurement."""

from __future__ import annotations

import io
import threading
from contextlib import redirect_stderr, redirect_stdout

import pytest
from rich.console import Console
from rich.table import Table

from hoap3.tools.analysis import output
from hoap3.tools.analysis.output import (
    CompilationMeter,
    Meter,
    PrintableConsole,
    print_json,
    print_line,
    progress,
)
from hoap3.tools.services.simulate import simulate


class Time:
    """Of `output`, by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        """Seconds."""
        return self.now


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    clock = Time()
    monkeypatch.setattr(output, "time", clock)
    return clock


def test_without_a_terminal_a_line_comes_after_two_seconds_and_then_each_ten(time: Time) -> None:
    heard = io.StringIO()
    with redirect_stderr(heard), progress("work") as meter:
        for second in range(25):
            time.now = 100.0 + second
            meter.part(second, 25)
    assert heard.getvalue().splitlines() == ["work: 8 %", "work: 48 %", "work: 88 %"]


def test_short_work_says_nothing(time: Time) -> None:
    heard = io.StringIO()
    with redirect_stderr(heard), redirect_stdout(heard), progress("work") as meter:
        for part in range(1000):
            meter.part(part, 1000)
            meter.step("one of many")
        time.now += 1.9
        meter.part(999, 1000)
    assert heard.getvalue() == ""


def test_a_terminal_shows_one_line_without_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    terminal = Console(file=screen, force_terminal=True, width=60, _environ={"TERM": "xterm"})
    monkeypatch.setattr(output, "notes", terminal)
    threads = threading.active_count()
    with progress("work") as meter:
        meter.step("first part")
        assert "%" not in screen.getvalue(), "nobody knows how much there is"
        assert threading.active_count() == threads
        meter.part(10, 10)
        print_line("a result")
    assert "work: first part" in screen.getvalue()
    assert "100%" in screen.getvalue()
    assert "a result" not in screen.getvalue()
    assert screen.getvalue().endswith("\x1b[2K")  # the line is removed


def test_a_dumb_terminal_gets_lines(monkeypatch: pytest.MonkeyPatch, time: Time) -> None:
    screen = io.StringIO()
    terminal = Console(file=screen, force_terminal=True, _environ={"TERM": "dumb"}, width=60)
    monkeypatch.setattr(output, "notes", terminal)
    with progress("work") as meter:
        time.now += 3.0
        meter.part(1, 2)
    assert "work: 50 %" in screen.getvalue()
    assert "\x1b[2K" not in screen.getvalue()


def test_nothing_to_do_is_no_division_by_zero(time: Time) -> None:
    time.now += 5.0
    Meter("work", None).part(0, 0)


@pytest.mark.parametrize("text", ["[bold]x[/bold] :smile: a:b:c", "x" * 500, "tab\there"])
def test_results_are_neither_markup_nor_wrapped(text: str, capsys) -> None:
    print_line(text)
    assert capsys.readouterr().out == text + "\n"


def test_closed_streams_are_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout", None)
    monkeypatch.setattr("sys.stderr", None)
    print_line("nobody reads this")
    print_json({"nor": "this"})
    output.print_note("nor this")


def test_a_simulation_tells_how_far_it_is() -> None:
    told: list[tuple[int, int]] = []
    run = simulate(duration=0.3, report=lambda done, whole: told.append((done, whole)))
    assert len(run.states) >= 300
    assert told == sorted(told)
    assert {whole for _, whole in told} == {300}
    assert len(told) >= 3


def test_compiled_kernels_are_counted(time: Time) -> None:
    heard = io.StringIO()
    with redirect_stderr(heard):
        meter = CompilationMeter()
        for second in range(13):
            time.now = 100.0 + second
            meter.step(f"kernel_{second}")
    first, second = heard.getvalue().splitlines()
    assert first.endswith(": number 3, kernel_2")
    assert second.endswith(": number 13, kernel_12")


def test_a_cell_that_is_wider_than_the_terminal_is_whole() -> None:
    screen, wide = io.StringIO(), "target_of_the_left_hand_" * 3
    table = Table("name", "value", box=None)
    table.add_row(wide, wide)
    PrintableConsole(file=screen, force_terminal=True, width=40, no_color=True).print(table)
    lines = screen.getvalue().splitlines()[1:]
    columns = ["".join(line.split()[i] for line in lines) for i in (0, 1)]
    assert columns == [wide, wide]
