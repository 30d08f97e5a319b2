"""Reads a report as a browser would: elements, their attributes, and the text below them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"meta", "br", "img", "link", "input", "hr", "base"}


@dataclass
class Element:
    """One element.

    Attributes:
        tag, attributes: as they stand there.
        parent: None for the root.
        children: elements and texts.
    """

    tag: str
    attributes: dict[str, str]
    parent: Element | None = None
    children: list[Element | str] = field(default_factory=list)

    def all(self, tag: str | None = None, class_: str | None = None) -> list[Element]:
        """Every element below, in order, of that tag and class."""
        found = []
        for child in self.children:
            if isinstance(child, Element):
                classes = child.attributes.get("class", "").split()
                if tag in {None, child.tag} and (class_ is None or class_ in classes):
                    found.append(child)
                found += child.all(tag, class_)
        return found

    def text(self) -> str:
        """All text below."""
        return "".join(c if isinstance(c, str) else c.text() for c in self.children)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.root = self.here = Element("root", {})

    def handle_starttag(self, tag, attrs):
        element = Element(tag, {name: value or "" for name, value in attrs}, self.here)
        assert len(attrs) == len(element.attributes), f"<{tag}> repeats an attribute"
        self.here.children.append(element)
        if tag not in VOID:
            self.here = element

    def handle_startendtag(self, tag, attrs):
        self.here.children.append(Element(tag, {n: v or "" for n, v in attrs}, self.here))

    def handle_endtag(self, tag):
        assert tag == self.here.tag, f"</{tag}> ends <{self.here.tag}>"
        self.here = self.here.parent

    def handle_data(self, data):
        shown = data if self.here.tag == "pre" else re.sub("[ \n]+", " ", data)
        self.here.children.append(shown)


class Page:
    """A whole page, well nested, or an AssertionError."""

    def __init__(self, source: str) -> None:
        reader = _Reader()
        reader.feed(source)
        reader.close()
        assert reader.here is reader.root
        self.source, self.root = source, reader.root

    def sections(self) -> list[str]:
        """Ids of its sections, in order."""
        return [element.attributes["id"] for element in self.root.all("section")]

    def by_id(self, name: str) -> Element:
        """The one element of that id."""
        (found,) = [e for e in self.root.all() if e.attributes.get("id") == name]
        return found

    def figures(self) -> dict[str, Element]:
        """Figures by name."""
        return {e.attributes["id"].removeprefix("figure-"): e for e in self.root.all("figure")}

    def tiles(self) -> dict[str, str]:
        """Value and notes of each figure at the head, by its name."""
        return {
            tile.all("span", "name")[0].text(): tile.text() for tile in self.root.all("li", "tile")
        }

    def rows(self, section: str, place: int = 0) -> list[list[str]]:
        """Cells of a table of a section, its head first."""
        table = self.by_id(section).all("table")[place]
        return [[c.text() for c in row.all() if c.tag in {"td", "th"}] for row in table.all("tr")]
