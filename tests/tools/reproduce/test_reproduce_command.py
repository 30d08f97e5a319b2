"""`hoap3 reproduce` finds papers, writes files, and ends with 1 where a row fails."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from hoap3.protocol.errors import ConfigError, UnknownNameError, UsageError
from hoap3.tools.cli.measurements import reproduce
from hoap3.tools.reproduce import papers
from hoap3.tools.reproduce.remake import papers as known_papers
from hoap3.tools.reproduce.rows import MEASURED, REPRODUCED

pytestmark = pytest.mark.slow

TINY = """
import numpy as np

from hoap3.tools.reproduce.figures import Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.rows import like, row


def remake(say):
    say("measuring")
    curve = Curve("line", np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    panel = Panel("", "", Axis("x_m", "x [m]"), Axis("y_m", "y [m]"), (curve,))
    figure = Figure("fig1", "Fig. 1", ((panel,),), (3.0, 2.0))
    rows = [row("Fig. 1: [y]", 2.0, OURS, like(2.0), "as it is"), row("t", None, 3.0, None, "ours")]
    return [figure], rows
"""

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(reproduce)


@pytest.fixture
def shelve(tmp_path, monkeypatch):
    """Put a paper beside the shipped ones: one new file."""
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    monkeypatch.setattr(papers, "__path__", [*papers.__path__, str(shelf)])

    def shelve(name, ours):
        (shelf / f"{name}.py").write_text(TINY.replace("OURS", repr(ours)), encoding="utf-8")

    return shelve


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_new_paper_is_one_new_file(shelve):
    assert known_papers() == ["bounds", "ghc", "qp12", "sdp"]
    shelve("tiny_new", 2.0)
    assert known_papers() == ["bounds", "ghc", "qp12", "sdp", "tiny_new"]


@pytest.mark.parametrize(("name", "ours", "code"), [("tiny_good", 2.0, 0), ("tiny_bad", 2.1, 1)])
def test_the_exit_code_says_whether_a_row_fails(shelve, tmp_path, name, ours, code):
    shelve(name, ours)
    done = invoke(name, "--out", tmp_path / "out", "--json")
    assert done.exit_code == code
    printed = json.loads(done.stdout)
    assert printed.keys() == {"counts", "rows", "machine", "files"}
    assert [row["pass"] for row in printed["rows"]] == [code == 0, None]
    assert [row["class"] for row in printed["rows"]] == [REPRODUCED, MEASURED]
    assert printed["counts"][REPRODUCED] == printed["counts"][MEASURED] == 1
    assert printed["counts"]["failed"] == code
    needed = {"item", "paper", "ours", "tolerance", "class", "pass", "why", "differs", "fitted"}
    assert all(row.keys() >= needed for row in printed["rows"])
    assert {"kernel", "processor", "versions"} <= printed["machine"].keys()


def test_files_are_those_that_are_named(shelve, tmp_path):
    shelve("tiny_files", 2.0)
    out = tmp_path / "deep" / "out"
    printed = json.loads(invoke("tiny_files", "--out", out, "--json").stdout)
    assert {str(path) for path in out.iterdir()} == set(printed["files"])
    assert json.loads((out / "rows.json").read_text(encoding="utf-8")) == printed
    with (out / "rows.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["item"] for row in rows] == ["Fig. 1: [y]", "t"]
    assert [row["pass"] for row in rows] == ["True", ""]


def test_people_see_rows_and_reasons_on_standard_output(shelve, tmp_path):
    shelve("tiny_people", 2.1)
    done = CliRunner().invoke(app, ["tiny_people", "--out", str(tmp_path)])
    for words in ("Fig. 1: [y]", "FAIL"):
        assert words in done.stdout
    assert done.stderr == ""  # it took less than two seconds


def test_no_earlier_reproduction_is_replaced(shelve, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shelve("tiny_again", 2.0)
    for number in (1, 2):
        done = invoke("tiny_again")
        assert done.exit_code == 0
        folders = {path.parent for path in Path("reproduced/tiny_again").glob("*/rows.json")}
        assert len(folders) == number
    assert any(str(folder) in done.stdout for folder in folders)
    error = invoke("tiny_again", "--out", folders.pop()).exception
    assert isinstance(error, ConfigError)
    assert "rows.json" in str(error)


def test_an_unknown_paper_is_answered_with_the_nearest(tmp_path):
    error = invoke("qp21", "--out", tmp_path).exception
    assert isinstance(error, UnknownNameError)
    assert isinstance(error, UsageError)  # which ends with exit code 2
    assert error.nearest == "qp12"
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path, shelve):
    shelve("tiny_blocked", 2.0)
    (tmp_path / "file").write_text("", encoding="utf-8")
    done = invoke("tiny_blocked", "--out", tmp_path / "file" / "out")
    assert isinstance(done.exception, ConfigError)
    assert "file/out" in str(done.exception)
    assert "measuring" not in done.stderr
