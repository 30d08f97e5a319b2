"""The README's pictures are made by their scripts, and stay small."""

from __future__ import annotations

import importlib
import re

import numpy as np
import pytest
from support import HOUSE

FOLDER = HOUSE / "docs" / "pictures" / "readme"
MOST = 600_000  # bytes of a moving picture


@pytest.fixture
def animate(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("animate")


@pytest.mark.parametrize("name", ["com", "dragged"])
def test_a_moving_picture_is_small_and_goes_round_in_five_seconds(name):
    from PIL import Image

    path = FOLDER / f"{name}.webp"
    assert path.stat().st_size < MOST
    with Image.open(path) as image:
        assert image.n_frames == 75
        assert image.info["loop"] == 0


def test_every_picture_of_the_readme_is_there_and_no_other():
    text = (HOUSE / "README.md").read_text(encoding="utf-8")
    text += "".join(page.read_text(encoding="utf-8") for page in (HOUSE / "docs").glob("*/*.md"))
    shown = set(re.findall(r"pictures/readme/([\w.]+)", text))
    there = {path.name for path in FOLDER.iterdir() if path.suffix not in {".py", ".pyc"}}
    assert shown == there - {"__pycache__"}


@pytest.mark.slow
def test_a_moving_picture_is_made_of_a_run(animate, tmp_path):
    film = animate.FILMS["dragged"](4)
    apart = [np.linalg.norm(each.point - each.target) for each in film.marks]
    assert max(apart) < 0.1  # it follows
    moved = np.ptp([each.point for each in film.marks], axis=0)
    assert moved.max() > 0.2
    animate.FILMS["four"] = lambda _: film
    try:
        path = animate.make("four", tmp_path)
    finally:
        del animate.FILMS["four"]
    from PIL import Image

    with Image.open(path) as image:
        assert image.n_frames == 4
        assert image.size == animate.SIZE
        first = np.asarray(image.convert("RGB"), float)
        image.seek(2)
        assert np.abs(np.asarray(image.convert("RGB"), float) - first).mean() > 0.5


@pytest.mark.slow
def test_the_centre_of_mass_visits_its_targets_and_ends_where_it_began(animate):
    film = animate.FILMS["com"](8)
    visited = np.array([film.marks[place].point for place in (0, 2, 4, 6)])
    assert visited == pytest.approx(animate.CORNERS[[0, 1, 2, 1]], abs=2e-3)
    for each in film.marks:
        assert np.abs(each.point[:2]).max() < 0.0365  # above the sole
    there, back = film.q[[1, 2, 3]], film.q[[7, 6, 5]]
    assert np.abs(there - back).max() < 0.1  # nothing jumps where it begins again
