"""One difference between the outputs of two revisions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """A field that differs.

    Attributes:
        field: file and place in it, such as ``run.json:verdicts.task``.
        kind: ``changed``, ``added`` or ``removed``.
        old, new: both values; of a table those of the row with the largest difference.
        size: largest absolute difference; None where the values are not numbers.
        where: row of the largest difference, such as ``tick 12``.
        count: rows that differ.
    """

    field: str
    kind: str
    old: Any = None
    new: Any = None
    size: float | None = None
    where: str = ""
    count: int = 1

    @property
    def group(self) -> str:
        """Field without places in lists, for a short printout."""
        return re.sub(r"\.\d+(?=\.|$)", ".*", self.field)

    def __str__(self) -> str:
        if self.kind == "added":
            return f"added {short(self.new)}"
        if self.kind == "removed":
            return f"removed {short(self.old)}"
        text = f"{short(self.old)} -> {short(self.new)}"
        if self.size is not None:
            text = f"largest difference {self.size:.3g} ({text})"
        rows = f", {self.count} rows" if self.count > 1 else ""
        return text + (f" at {self.where}" if self.where else "") + rows


def short(value: Any) -> str:
    """A value as text of at most 60 characters."""
    text = f"{value!r}"
    return text if len(text) <= 60 else f"{text[:57]}..."
