"""What is said of a URDF that was read: what was found, what was guessed, what was left out."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from hoap3.protocol.robot.urdf import is_finite

LONG = 10.0  # m: more is probably in millimetres
About = Literal["read", "guessed", "left out"]
SOME_NAMES = 6  # of a note in one line


@dataclass(frozen=True)
class Note:
    """One finding, and the links or joints that it holds for.

    Attributes:
        about: whether it was read as it stands, guessed, or left out.
        text: what is so, and why.
        names: of joints, links or elements, in the order of the file; may be empty.
    """

    about: About
    text: str
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        return self.line(SOME_NAMES)

    def line(self, most: int | None = None) -> str:
        """In one line, with at most so many names."""
        names = ", ".join(self.names[:most])
        more = 0 if most is None else len(self.names) - most
        others = f" and {more} more" if more > 0 else ""
        return f"{self.about}: {self.text}" + (f": {names}{others}" if names else "")


class Notes:
    """Collects findings; one that holds for several names is told once."""

    def __init__(self) -> None:
        self._found: defaultdict[tuple[About, str], dict[str, None]] = defaultdict(dict)

    def add(self, about: About, text: str, *names: str) -> None:
        """Note something, for some names."""
        self._found[about, text].update(dict.fromkeys(names))

    def lengths(self, words: Iterable[str], name: str) -> None:
        """Note lengths [m] that are so great that they are probably in another unit."""
        if any(is_finite(word) and abs(float(word)) > LONG for word in words):
            self.add("read", f"lengths of more than {LONG:g} m, perhaps in millimetres", name)

    @property
    def all(self) -> tuple[Note, ...]:
        """In the order in which they were first found."""
        return tuple(
            Note(about, text, tuple(names)) for (about, text), names in self._found.items()
        )
