"""The list of intended differences, `ledger.md`: a table of globs with reasons."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from .difference import Difference

LEDGER = Path(__file__).with_name("ledger.md")


@dataclass(frozen=True)
class Entry:
    """One line of the ledger."""

    line: int
    case: str
    field: str
    change: str
    reason: str

    def covers(self, case: str, difference: Difference) -> bool:
        """Whether this line declares a difference of a case as intended."""
        return (
            fnmatchcase(case, self.case)
            and fnmatchcase(difference.field, self.field)
            and change_matches(self.change, difference)
        )


def change_matches(change: str, difference: Difference) -> bool:
    """Whether a difference is of the kind that a line allows."""
    if change in {"any", difference.kind}:
        return True
    if change.startswith("<="):
        return difference.size is not None and difference.size <= float(change[2:])
    before, arrow, after = change.partition("->")
    if not arrow or difference.kind != "changed":
        return False
    values = (difference.old, before), (difference.new, after)
    return all(fnmatchcase(text_of(value), glob.strip()) for value, glob in values)


def text_of(value: Any) -> str:
    """A value as a ledger has it: text without quotes, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, default=str)


def read_ledger(text: str) -> list[Entry]:
    """Lines of the table that are neither its header nor the rule below that.

    Raises:
        ValueError: a line has other than four cells, or a change that is none.
    """
    entries = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("|") or set(line) <= set("|-: "):
            continue
        cells = [cell.strip().strip("`") for cell in line.strip().strip("|").split("|")]
        if cells == ["case", "field", "change", "reason"]:
            continue
        if len(cells) != 4 or not all(cells):
            raise ValueError(f"ledger line {number}: needs four cells (found {line!r})")
        known = cells[2] in {"any", "changed", "added", "removed"}
        if not known and "->" not in cells[2] and not cells[2].startswith("<="):
            raise ValueError(f"ledger line {number}: unknown change (found {cells[2]!r})")
        entries.append(Entry(number, *cells))
    return entries
