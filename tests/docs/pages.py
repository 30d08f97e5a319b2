"""Reads README.md and the pages of docs/ as far as the tests need it: blocks, spans, links.

An HTML comment directly before a fenced block says what the tests do with it:

    <!-- file: NAME -->          it is the content of a file
    <!-- parsed only: WHY -->    its `hoap3` commands are parsed and their settings checked
    <!-- fragment: NAME -->      it replaces keys of that config
    <!-- not run: WHY -->        nothing
    <!-- exits: CODE -->         each of its commands ends with that code, rather than with 0
    <!-- prints -->              its lines are among what the block before it printed
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from support import HOUSE

PAGES = [HOUSE / "README.md", *sorted((HOUSE / "docs").glob("*/*.md"))]
NAMES = [page.name for page in PAGES]

_COMMENT = re.compile(r"<!-- (?P<word>[a-z ]+?)(?:: (?P<rest>.*))? -->")
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_SPAN = re.compile(r"`([^`\n]+)`")


@dataclass(frozen=True)
class Block:
    """One fenced block, with the comment before it: `word` and `rest`."""

    line: int
    language: str
    text: str
    word: str
    rest: str

    @property
    def commands(self) -> list[str]:
        """Lines of a shell block, without blank ones."""
        return [line for line in self.text.splitlines() if line.strip()]


def path_of(name: str) -> Path:
    """Where a page lies, named by its file."""
    return next(path for path in PAGES if path.name == name)


def page(name: str) -> str:
    """Text of a page, named by its file."""
    return path_of(name).read_text(encoding="utf-8")


def blocks(name: str) -> list[Block]:
    """Fenced blocks of a page, in order."""
    found, before, lines = [], "", page(name).splitlines()
    at = 0
    while at < len(lines):
        line = lines[at]
        if line.startswith("```"):
            end = lines.index("```", at + 1)
            comment = _COMMENT.fullmatch(before)
            word, rest = (comment["word"], comment["rest"] or "") if comment else ("", "")
            text = "".join(each + "\n" for each in lines[at + 1 : end])
            found.append(Block(at + 1, line[3:], text, word, rest))
            at = end
        before = lines[at] if lines[at].strip() else before
        at += 1
    return found


def prose(name: str) -> str:
    """A page without its blocks."""
    return re.sub(r"^```.*?^```$", "", page(name), flags=re.DOTALL | re.MULTILINE)


def spans(name: str) -> list[str]:
    """Inline code of a page."""
    return _SPAN.findall(prose(name))


def links(name: str) -> list[str]:
    """Targets of a page's links."""
    return _LINK.findall(prose(name))


def anchors(name: str) -> set[str]:
    """What a link to a heading of a page may say, as GitHub makes it."""
    headings = re.findall(r"^#+ (.+)$", prose(name), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings}
