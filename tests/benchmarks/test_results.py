"""`benchmarks.results` renders each saved table with its command and n, and reports failures."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from benchmarks import results
from hoap3.protocol.errors import Hoap3Error, UsageError

SAVED = json.loads(Path(__file__).with_name("saved_results.json").read_text(encoding="utf-8"))
TABLES = [(name, table) for name, each in results.COMMANDS.items() for table in each["tables"]]
N = {  # of saved_results.json; 10 for the others
    "Hierarchies of five tasks": "10 to 200",
    "Hierarchies of humanoid32 by number of tasks, p50 [µs]": "10 to 200",
    "Whole ticks of ghc": "200",
    "Gains": "10 to 200",
    "Round trip and bare TCP echo": "271",
    "Round trip and bare TCP echo by block": "200",
    "Controllers compared in lockstep": "500",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A saved quick run, a few rows of each command."""
    kept = tmp_path / "kept"
    kept.mkdir()
    for name, content in SAVED.items():
        save(kept, name, content)
    return kept


def save(folder: Path, name: str, content: dict[str, Any]) -> None:
    (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")


def sections(page: str) -> dict[str, list[str]]:
    """Lines of a page by the title of their section."""
    parts = (part.split("\n") for part in page.split("\n## "))
    return {lines[0]: lines[1:] for lines in parts}


def cells(lines: list[str]) -> list[dict[str, str]]:
    """Rows of the table among these lines, by column."""
    header, _, *rows = (
        [cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "|" in line[:1]
    )
    return [dict(zip(header, row, strict=True)) for row in rows]


def render(folder: Path) -> dict[str, list[str]]:
    page, failed = results.render_page(folder, list(results.COMMANDS))
    assert not failed
    return sections(page)


@pytest.mark.parametrize(("name", "table"), TABLES, ids=[table["title"] for _, table in TABLES])
def test_each_table_has_its_command_and_n(folder: Path, name: str, table: dict[str, Any]) -> None:
    lines = render(folder)[table["title"]]
    n = N.get(table["title"], "10")
    assert lines[1].startswith(f"`{SAVED[name]['command']}`: n = {n}, ")
    assert cells(lines)
    assert ("`paper`: " in lines[1]) == ("paper=" in table.get("columns", ""))


def test_cells_are_rounded_selected_and_arranged(folder: Path) -> None:
    page = render(folder)
    qp12, osqp = cells(page["Solvers"])
    assert qp12["solver"] == "qp12"
    assert qp12["p50_us"] == "0.806"
    assert osqp["paper"] == "32.3"
    assert osqp["worst_error"] == "1e-04"
    by_tasks = cells(page["Hierarchies of humanoid32 by number of tasks, p50 [µs]"])
    assert [row["tasks"] for row in by_tasks] == ["2", "5"]
    assert by_tasks[0]["ghc, bounded"] == ""
    assert by_tasks[1]["ghc, bounded"] == "30.1"
    ticks = cells(page["Whole ticks of ghc"])
    assert [row["robot"] for row in ticks] == ["humanoid32"]
    scaling = page["QP12 by number of joints n, p50 [µs]"]
    assert "`slopes`: qp12 0.970." in scaling
    assert "`left_out`: solver quadprog, n 14, took_s 1.04." in scaling


def test_the_head_has_the_machine_its_load_and_that_the_run_was_quick(folder: Path) -> None:
    page, _ = results.render_page(folder, ["cycle"])
    head = page.partition("\n## ")[0]
    assert head.startswith("# Measured tables, 2026-11-29\n")
    assert results.TRIAL in head
    facts = [list(row.values()) for row in cells(head.split("\n"))]
    assert ["load average at the start (1, 5, 15 min)", "0.25 0.50 0.75"] in facts
    assert ["load average at the end", "1.25 1.50 1.75"] in facts
    assert {"CPU", "cores", "kernel", "Python", "libraries", "real-time rights"} <= {*dict(facts)}
    assert "Not measured: compare, gains, " in head


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"output": None, "exit_code": 2, "stderr": "compiling\nerror: no CPU\n"}, "error: no CPU"),
        ({"output": {"rows": []}}, "A cycle: the JSON has no such rows"),
        ({"output": {"rows": [{"samples": 3}]}}, "the JSON has no key 'solver'"),
    ],
)
def test_a_failure_is_in_the_page_and_in_the_exit_code(
    folder: Path, run_command: Any, change: dict[str, Any], reason: str
) -> None:
    save(folder, "cycle", SAVED["cycle"] | change)
    out = folder / "page.md"
    done = run_command(results.command, "--from", folder, "--out", out)
    assert isinstance(done.exception, Hoap3Error)
    assert "cycle" in str(done.exception)
    page = sections(out.read_text(encoding="utf-8"))
    assert reason in "\n".join(page["cycle"])
    assert cells(page["Limits"])


def test_commands_after_a_failed_one_run_and_their_json_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_command: Any
) -> None:
    prints = shlex.quote('print(\'{"rows": [{"samples": 7, "solver": "a"}]}\')')
    tables = [{"title": "Second", "columns": "solver"}]
    commands = {
        "first": {"command": "python -c 'raise SystemExit(3)'", "quick": "", "tables": tables},
        "second": {"command": f"python -c {prints}", "full": "full", "tables": tables},
    }
    monkeypatch.setattr(results, "COMMANDS", commands)
    out, kept = tmp_path / "page.md", tmp_path / "kept"
    done = run_command(results.command, "--out", out, "--keep", kept)
    assert isinstance(done.exception, Hoap3Error)
    page = sections(out.read_text(encoding="utf-8"))
    assert "failed, exit code 3" in page["first"][1]
    assert page["Second"][1].startswith(f"`python -c {prints} full --json`: n = 7, ")
    out.unlink()
    assert (
        run_command(results.command, "--from", kept, "--only", "second", "--out", out).exit_code
        == 0
    )
    run = json.loads((kept / results.RUN).read_text())
    assert len(run["load"]) == 2
    assert {"numpy", "clarabel", "piqp"} <= run["machine"]["versions"].keys()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--only", "cycles"], "Did you mean 'cycle'"),
        (["--from", "kept", "--quick"], "--from"),
        (["--from", "nowhere"], "nowhere/run.json"),
        (["--from", "kept", "--out", "kept/run.json"], "kept/run.json exists already"),
        (["--keep", "kept", "--out", "page.md"], "kept/run.json exists already"),
    ],
)
def test_wrong_options_are_refused_before_anything_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch, run_command: Any, words: list[str], problem: str
) -> None:
    monkeypatch.chdir(folder.parent)
    monkeypatch.setattr(results, "run_command", None)
    done = run_command(results.command, *words)
    assert isinstance(done.exception, UsageError)
    assert problem in str(done.exception)


@pytest.mark.slow
def test_a_quick_run_measures(tmp_path: Path, run_command: Any) -> None:
    out = tmp_path / "page.md"
    done = run_command(results.command, "--quick", "--only", "cycle", "--out", out)
    assert done.exit_code == 0, done.output
    page = sections(out.read_text(encoding="utf-8"))
    assert [row["solver"] for row in cells(page["A cycle"])][-1] == "reference"
