"""docs/papers.md leaves nothing of a paper out, and names only what exists."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest
from pages import HOUSE, page, prose, table

from hoap3.tools.reproduce.remake import papers

VERDICTS = {"same", "corrected", "not reproducible", "not built yet"}
ROMAN = ("I", "II", "III", "IV", "V")
NUMBERED = {
    "QP12": {"equations": 41, "algorithms": 2, "figures": 8, "tables": 1},
    "Bounds": {"equations": 34, "algorithms": 4, "figures": 5, "tables": 0},
    "GHC": {"equations": 24, "algorithms": 2, "figures": 12, "tables": 1},
    "SDP": {"equations": 29, "algorithms": 0, "figures": 7, "tables": 0},
}
"""How many of each a paper has, by the heading of its section."""

STATEMENTS = {
    "QP12": (
        *("Remark 1", "Example 2", "Definition 3"),
        *("Lemma 4", "Lemma 5", "Proposition 6", "Remark 7"),
    ),
    "Bounds": (),
    "GHC": (),
    "SDP": (),
}
"""What else has a number: one count for all kinds, so each number is there once."""


def numbered(paper: str) -> list[str]:
    """Everything with a number in a paper, as the page calls it."""
    count = NUMBERED[paper]
    return [
        *(f"({k})" for k in range(1, count["equations"] + 1)),
        *STATEMENTS[paper],
        *(f"Algorithm {k}" for k in range(1, count["algorithms"] + 1)),
        *(f"Fig. {k}" for k in range(1, count["figures"] + 1)),
        *(f"Table {roman}" for roman in ROMAN[: count["tables"]]),
    ]


def section(paper: str) -> str:
    """Text below the heading of a paper."""
    _, _, rest = prose("papers.md").partition(f"\n## {paper}\n")
    return rest.partition("\n## ")[0]


def rows_with(paper: str, *columns: str) -> list[dict[str, str]]:
    """Rows of the first table of a section that has these columns."""
    head = f"| {' | '.join(columns)} |"
    lines = section(paper)[section(paper).index(head) :].splitlines()
    rows = []
    for line in lines[2:]:
        if not line.startswith("|"):
            break
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        rows.append(dict(zip(columns, cells, strict=True)))
    return rows


def items(paper: str) -> list[dict[str, str]]:
    return rows_with(paper, "item", "what", "file", "test", "verdict", "note")


@cache
def functions(path: str) -> set[str]:
    """Names of the tests in a file."""
    tree = ast.parse((HOUSE / path).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def check_places(row: dict[str, str]) -> None:
    file, place = row["file"].strip("`"), row["test"].strip("`")
    assert (HOUSE / file).is_file(), row
    path, _, name = place.partition("::")
    assert path.startswith(("tests/", "tools/testing/")), row
    assert name.startswith("test_"), row
    assert name in functions(path), row


def test_every_section_is_a_paper_that_is_known_here():
    assert re.findall(r"^## (.+)$", page("papers.md"), flags=re.MULTILINE) == [*NUMBERED]


@pytest.mark.parametrize("paper", NUMBERED)
def test_everything_with_a_number_is_there_once_and_in_order(paper):
    assert [row["item"] for row in items(paper)] == numbered(paper)


def test_statements_are_counted_without_a_gap():
    for statements in STATEMENTS.values():
        assert [int(name.split()[1]) for name in statements] == [*range(1, len(statements) + 1)]


@pytest.mark.parametrize("paper", [paper for paper in NUMBERED if paper.lower() in papers()])
def test_of_a_paper_that_is_made_again_nothing_is_left_to_build(paper):
    assert [row["item"] for row in items(paper) if row["verdict"] == "not built yet"] == []


@pytest.mark.parametrize("paper", NUMBERED)
def test_verdicts_are_those_that_the_page_defines(paper):
    assert {row["verdict"] for row in table("papers.md", "Papers")} == VERDICTS
    for row in items(paper):
        assert row["verdict"] in VERDICTS, row
        assert row["what"], row


@pytest.mark.parametrize("paper", NUMBERED)
def test_what_is_built_names_a_file_and_a_test_that_exist(paper):
    for row in items(paper):
        if row["verdict"] == "not built yet":
            assert row["file"] == row["test"] == "–", row
        else:
            check_places(row)


@pytest.mark.parametrize("paper", NUMBERED)
def test_what_differs_gives_a_reason(paper):
    for row in items(paper):
        if row["verdict"] in {"corrected", "not reproducible"}:
            assert len(row["note"].split()) >= 3, row


@pytest.mark.parametrize("paper", NUMBERED)
def test_what_has_no_number_exists_too(paper):
    for row in rows_with(paper, "what", "file", "test", "note"):
        check_places(row)


def test_references_that_are_named_exist():
    """`NAME_reference.function`: plain numpy that a kernel is compared with."""
    rooms = ("protocol", "remote_controller", "robot_emulator")
    files = {path.stem: path for room in rooms for path in (HOUSE / room).rglob("*_reference.py")}
    named = set(re.findall(r"`(\w+_reference)\.(\w+)`", page("papers.md")))
    assert named
    for module, function in named:
        assert function in functions(str(files[module].relative_to(HOUSE))), (module, function)


def test_every_paper_that_can_be_made_again_is_shown():
    for name in papers():
        assert f"`hoap3 reproduce {name}`" in page("papers.md"), name
