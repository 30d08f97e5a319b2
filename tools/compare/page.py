"""The page of a comparison: figures, table and settings in one HTML file without any time."""

from __future__ import annotations

import yaml

from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.drawings import drawings, role
from hoap3.tools.compare.figures import WORDS
from hoap3.tools.compare.words import cell, shown_words, unit
from hoap3.tools.html.document import PAGES

SECTIONS = {"plots": "Over time", "table": "Figures", "settings": "Settings", "words": "Words"}


def page(made: Comparison) -> str:
    """The whole file."""
    settings = [
        {"controller": each.config.controller, "parameters": each.parameters}
        for each in made.candidates
    ]
    return PAGES.get_template("compare/templates/page.html").render(
        kind="comparison",
        title=" · ".join(made.labels),
        sections=SECTIONS,
        made=made,
        drawings=drawings(made),
        role=role,
        rows=[
            (word, unit(word.unit, made), [cell(found, word.key) for found in made.figures])
            for word in shown_words(made)
        ],
        settings=[yaml.safe_dump(each, sort_keys=False, allow_unicode=True) for each in settings],
        words=WORDS,
    )
