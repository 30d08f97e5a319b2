"""Text on its way to a terminal: what would steer it is written out instead.

Names of robots, clients and tasks, and texts of robots and logs come from strangers. A terminal
obeys the escape sequences in them: it would hide a line, fake another, or set its title.
"""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    """A whole text: control characters as in a Python string; line breaks and tabs stay."""
    return "".join(_visible(char, "\n\t") for char in text)


def one_line(name: object) -> str:
    """A name or a sentence inside a line: line breaks and tabs are escaped, too."""
    return "".join(_visible(char, "") for char in str(name))


def _visible(char: str, keep: str) -> str:
    if char.isprintable() or char in keep or unicodedata.category(char) == "Zs":  # a space
        return char
    return char.encode("unicode_escape").decode()
