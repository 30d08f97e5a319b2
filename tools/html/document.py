"""What every page of ours is made of: one HTML file that loads nothing and runs nothing.

The content security policy at its head forbids both, so that even a mistake of ours could not let a
log do what only its reader may.
"""

from __future__ import annotations

from hoap3.tools.html.drawing import Drawing, Key
from hoap3.tools.html.markup import Markup, element, more
from hoap3.tools.html.style import STYLE

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'"


def document(title: str, *content: object) -> str:
    """The whole file around what stands in its body."""
    head = element(
        "head",
        Markup('<meta charset="utf-8">'),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        element("title", title),
        Markup(f"<style>{STYLE}</style>"),
    )
    body = element("body", *content)
    return f'<!DOCTYPE html>\n<html lang="en">{head}{body}</html>\n'


def figure(drawing: Drawing) -> Markup:
    """A drawing with its title, legend and words."""
    return element(
        "figure",
        element("h3", drawing.title),
        Markup(drawing.svg),
        element("ul", *map(_key, drawing.keys), class_="legend"),
        element("p", drawing.figures, class_="numbers"),
        more(
            "What is this, and how does trouble look?",
            element("p", drawing.what),
            element("p", element("b", "Trouble: "), drawing.trouble),
            class_="what",
        ),
        id=f"figure-{drawing.name}",
        role="group",
        aria_label=drawing.title,
    )


def _key(key: Key) -> Markup:
    mark = element("span", class_=f"mark {key.mark}", style=f"color: var(--{key.role})")
    return element("li", mark, element("span", key.text))
