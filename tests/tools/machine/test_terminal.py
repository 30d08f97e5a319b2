"""No text from a network or a log steers the terminal that it is shown on."""

from __future__ import annotations

import io
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from hoap3.tools.analysis.output import PrintableConsole, print_line, print_note
from hoap3.tools.machine.processes import one_line, printable, to_people

ESCAPES = "\x1b]0;title\x07 \x1b[2J \x9b31m \r \x08 \x00 \u202e \u2028 \udc80"


def harmless(char: str) -> bool:
    return char.isprintable() or unicodedata.category(char) == "Zs"  # such as between thousands


@given(st.text())
def test_only_printable_characters_and_line_breaks_are_left(text):
    assert all(harmless(char) or char in "\n\t" for char in printable(text))
    assert all(harmless(char) for char in one_line(text))


@given(st.text(st.characters(categories=("L", "N", "P", "S", "Zs"))))
def test_what_is_printable_stays_as_it_is(text):
    assert printable(text) == one_line(text) == text


def test_line_breaks_of_a_name_are_escaped():
    assert printable("a\n\tb\x1bc") == "a\n\tb\\x1bc"
    assert one_line("a\n\tb\x1bc") == "a\\n\\tb\\x1bc"


@pytest.mark.parametrize("say", [to_people, print_note])
def test_lines_for_people_are_printable(say, capsys):
    say(f"robot {ESCAPES}")
    told = capsys.readouterr().err
    assert told == printable(f"robot {ESCAPES}\n")
    assert "\x1b" not in told


def test_results_are_printable(capsys):
    print_line(ESCAPES)
    assert "\x1b" not in capsys.readouterr().out


def test_whatever_a_console_is_given_is_printable():
    stream = io.StringIO()
    console = PrintableConsole(file=stream, force_terminal=True, color_system=None, width=300)
    console.print(f"said {ESCAPES}", markup=False)
    console.print(f"said {ESCAPES}")
    table = Table(title=ESCAPES, caption=ESCAPES)
    table.add_column(ESCAPES)
    table.add_row(f"cell {ESCAPES}")
    console.print(table)
    assert all(char.isprintable() or char in "\n\t" for char in stream.getvalue())
