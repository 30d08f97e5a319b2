"""Write the table of robots and controllers in docs/guides/robots.md."""

from __future__ import annotations

from pathlib import Path

from hoap3.remote_controller.pairs import HELD_BACK, PAIRS, POSTURES

COLUMNS = {
    "hoap3": "hoap3",
    "humanoid32": "humanoid32",
    "humanoid32_torque": "humanoid32",
    "ur5": "ur5",
    "hoap3_standing": "hoap3",
    "hoap3_standing_torque": "hoap3",
    "humanoid32_standing": "humanoid32",
    "lwr": "lwr",
    "lwr_weightless": "lwr",
    "lwr_with_table": "lwr",
    "baxter": "baxter",
    "baxter_left_arm": "baxter_left_arm",
    "baxter_right_arm": "baxter_right_arm",
}
"""By what `--robot` takes, the column that shows it."""

BEGIN = "<!-- pairs: written by `python -m benchmarks.tables.pairs_table` -->\n"
END = "<!-- end of pairs -->\n"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "robots.md"


def table() -> str:
    """Markdown: a row for each shipped controller config, a column for each robot."""
    robots = list(dict.fromkeys(COLUMNS.values()))
    lines = [
        "| `--controller` | " + " | ".join(f"`{robot}`" for robot in robots) + " |",
        "|---" * (len(robots) + 1) + "|",
    ]
    for config in PAIRS:
        cells = [_cell(config, robot) for robot in robots]
        lines.append(f"| `{config}` | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(config: str, robot: str) -> str:
    marks = []
    for name in PAIRS[config]:
        if COLUMNS[name] != robot:
            continue
        mark = "yes" if name == robot else f"`{name}`"
        mark += "¹" if (config, name) in HELD_BACK else ""
        mark += "²" if (config, name) in POSTURES else ""
        marks.append(mark)
    return ", ".join(marks)


def written(page: str) -> str:
    """The page with the table as it is now.

    Raises:
        ValueError: the page has no place for it.
    """
    return with_table(page, BEGIN, table(), END)


def with_table(page: str, begin: str, lines: str, end: str) -> str:
    """A page with a table between two of its lines.

    Raises:
        ValueError: the page lacks one of them.
    """
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"the page lacks the lines {begin!r} and {end!r}")
    return f"{before}{begin}\n{lines}\n{end}{after}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
