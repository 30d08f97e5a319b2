"""The page of a comparison: figures, table and settings in one HTML file without any time."""

from __future__ import annotations

import yaml

from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.drawings import drawings, role
from hoap3.tools.compare.figures import WORDS
from hoap3.tools.compare.words import cell, shown_words, unit
from hoap3.tools.html.document import document, figure
from hoap3.tools.html.markup import Markup, element, join, link, more, table

SECTIONS = {
    "plots": "Over time",
    "table": "Figures",
    "settings": "Settings",
    "words": "Words",
}


def page(made: Comparison) -> str:
    """The whole file."""
    title = " · ".join(made.labels)
    plots = [figure(each) for each in drawings(made)]
    return document(
        f"{title} · comparison",
        _header(made, title),
        element(
            "main",
            element(
                "section",
                element("h2", SECTIONS["plots"]),
                element("div", *plots, class_="grid")
                if plots
                else element("p", "No controller answered: there is nothing to draw."),
                id="plots",
            ),
            _table(made),
            _settings(made),
            _words(),
        ),
        element("footer", "Made by hoap3 compare. This page loads nothing and runs nothing."),
    )


def _header(made: Comparison, title: str) -> Markup:
    facts = made.facts
    on = f"robot {facts['robot']}, {facts['joints']} joints"
    how = (
        f"each moves its own for {facts['duration_s']:g} s in lockstep, seed {facts['seed']}"
        if made.closed_loop
        else f"each answers the States of {facts['log']}, and none of it is applied"
    )
    found = [element("p", each) for each in made.findings]
    said = [*(element("p", each) for each in made.notes), *found]
    return element(
        "header",
        element(
            "h1",
            title,
            element(
                "span",
                "findings" if found else "nothing wrong",
                class_="badge warn" if found else "badge fit",
            ),
        ),
        element("p", f"{made.facts['mode']} · {on} · {how}", class_="sub"),
        element("nav", *(link(anchor, name) for anchor, name in SECTIONS.items())),
        element("div", *said, class_="gaps") if said else "",
    )


def _table(made: Comparison) -> Markup:
    head: list[object] = [
        "",
        *(
            element("span", label, style=f"color: var(--{role(place)})")
            for place, label in enumerate(made.labels)
        ),
    ]
    rows = []
    for word in shown_words(made):
        name = element("span", link(f"word-{word.key.replace('.', '-')}", word.name))
        shown = unit(word.unit, made)
        title = join([name, f" [{shown}]" if shown else ""])
        rows.append([title, *(cell(found, word.key) for found in made.figures)])
    return element(
        "section",
        element("h2", SECTIONS["table"]),
        table(head, rows),
        element(
            "p",
            "–: does not apply, or is not known. Times are in timing.json: no two runs share them.",
            class_="sub",
        ),
        id="table",
    )


def _settings(made: Comparison) -> Markup:
    parts = []
    for place, each in enumerate(made.candidates):
        whole = {"controller": each.config.controller, "parameters": each.parameters}
        text = yaml.safe_dump(whole, sort_keys=False, allow_unicode=True)
        name = element("span", each.label, style=f"color: var(--{role(place)})")
        parts.append(more(name, element("pre", text.rstrip())))
    return element("section", element("h2", SECTIONS["settings"]), *parts, id="settings")


def _words() -> Markup:
    entries = join(
        join(
            [
                element("dt", word.name, id=f"word-{word.key.replace('.', '-')}"),
                element("dd", word.meaning),
            ]
        )
        for word in WORDS
    )
    return element("section", element("h2", SECTIONS["words"]), element("dl", entries), id="words")
