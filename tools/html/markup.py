"""HTML by small functions, each of which escapes what it is given.

What is markup already is `Markup`; all else is text of anybody, perhaps from a log that somebody
sent. So a string cannot become an element by being forgotten.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class Markup(str):
    """Text that is HTML."""

    __slots__ = ()


def text(content: object) -> Markup:
    """Anything as HTML: markup as it is, text escaped, control characters as �."""
    if isinstance(content, Markup):
        return content
    return Markup(html.escape(_UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", str(content))))


def join(parts: Iterable[object]) -> Markup:
    """One after the other."""
    return Markup("".join(text(part) for part in parts))


def element(tag: str, *content: object, **attributes: str) -> Markup:
    """`<tag name="value">content</tag>`; `class_` stands for class, and a `_` in names for `-`."""
    given = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{text(value)}"'
        for name, value in attributes.items()
    )
    return Markup(f"<{tag}{given}>{join(content)}</{tag}>")


def link(anchor: str, content: object) -> Markup:
    """To another place of the page."""
    return element("a", content, href=f"#{anchor}")


def table(
    head: Sequence[object], rows: Iterable[Sequence[object]], *, words: int = 1, class_: str = ""
) -> Markup:
    """A table that scrolls by itself on a narrow page; the first `words` columns are text.

    An empty `head` gives a table without one.
    """

    def line(tag: str, cells: Sequence[object]) -> Markup:
        kinds = ("word" if place < words else "figure" for place in range(len(cells)))
        return element(
            "tr",
            *(element(tag, cell, class_=kind) for cell, kind in zip(cells, kinds, strict=True)),
        )

    top = element("thead", line("th", head)) if head else ""
    whole = element("table", top, element("tbody", *(line("td", row) for row in rows)))
    return element("div", whole, class_=f"scroll {class_}".strip())


def more(title: object, *content: object, class_: str = "more") -> Markup:
    """What opens by a click."""
    return element("details", element("summary", title), *content, class_=class_)
