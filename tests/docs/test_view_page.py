"""The page on the live page explains every plot, button and choice, and has its pictures."""

from __future__ import annotations

import re

import pytest
from support import HOUSE

from hoap3.tools.view.picture.frame import PLOTS

TEXT = (HOUSE / "docs" / "view_page.md").read_text(encoding="utf-8").replace("\\|", "|")
PAGE = (HOUSE / "tools" / "view" / "static" / "index.html").read_text(encoding="utf-8")
PICTURES = re.findall(r"\]\((pictures/view/[^)]+)\)", TEXT)


@pytest.mark.parametrize("label", [label for _, label, _, _ in PLOTS])
def test_every_plot_is_explained(label):
    section = TEXT[TEXT.index("## Plots") : TEXT.index("## Joints")]
    assert label in section


def test_every_button_choice_and_heading_is_explained():
    words = re.findall(
        r"<button[^>]*>([^<]+)|<label>([^<]+?) *<|<h2>([^<]+)|\n +<label>(\w+)", PAGE
    )
    names = {next(filter(None, found)).strip() for found in words}
    assert {"Stop", "Recover", "Steer", "Hold to drive", "Verdicts", "Axes", "Speed"} <= names
    assert {name for name in names if name not in TEXT} == set()


def test_every_mark_of_the_key_is_explained():
    key = PAGE[PAGE.index('id="key"') : PAGE.index('id="timeline"')]
    marks = re.findall(r"</i>([a-zA-Z ]{3,})</li>", key)
    assert "support polygon" in marks
    text = TEXT.lower().replace("zero-moment point", "zmp")
    assert [mark for mark in marks if mark.lower() not in text] == []


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_are_there_and_small(picture):
    assert 1000 < (HOUSE / "docs" / picture).stat().st_size < 200_000
