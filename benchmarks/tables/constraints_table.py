"""Write the table of constraints in docs/guides/controllers.md."""

from __future__ import annotations

from pathlib import Path

from benchmarks.tables.pairs_table import with_table
from benchmarks.tables.tasks_table import level
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.registry import of_constraints

BEGIN = "<!-- constraints: written by `python -m benchmarks.tables.constraints_table` -->\n"
END = "<!-- end of constraints -->\n"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "controllers.md"


def serves(controller: str, constraint: str) -> bool:
    """Whether a controller that takes constraints takes this one of ours."""
    found: bool = constraints.find(constraint).serves(level(controller))
    return found


def table() -> str:
    """Markdown: a row for each constraint, with its guarantee, and a column for each controller."""
    columns = of_constraints()
    lines = [
        "| constraint | guarantee | " + " | ".join(f"`{each}`" for each in columns) + " |",
        "|---" * (len(columns) + 2) + "|",
    ]
    for name in constraints.BUILTIN:
        cells = ["yes" if serves(controller, name) else "" for controller in columns]
        guarantee = constraints.find(name).guarantee
        lines.append(f"| `{name}` | {guarantee} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def written(page: str) -> str:
    """The page with the table as it is now.

    Raises:
        ValueError: the page has no place for it.
    """
    return with_table(page, BEGIN, table(), END)


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
