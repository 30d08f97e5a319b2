"""What stands on a page as one figure: the drawing, its legend, and the words around it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """One entry of a legend.

    Attributes:
        role: colour, of `palette`.
        text: what it stands for; from a log, so not yet fit for HTML.
        mark: how it is drawn: "line", "dash", "dot", "ring", "area".
    """

    role: str
    text: str
    mark: str = "line"


@dataclass(frozen=True)
class Drawing:
    """One figure.

    Attributes:
        name: its anchor.
        title: what to see in it.
        svg: the drawing itself.
        keys: legend.
        figures: n and percentiles of what is drawn, in words.
        wide: whether it takes all the width of the page.
    """

    name: str
    title: str
    svg: str
    keys: tuple[Key, ...]
    figures: str
    wide: bool = False
