"""docs/guides/controllers.md: every choice runs, and every picture is what the code gives."""

from __future__ import annotations

import re
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from pages import HOUSE, blocks

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.lyapunov_qp.stable_qp import StableQpController
from hoap3.tools.services.simulate import simulate

PAGE = "controllers.md"
FOLDER = HOUSE / "docs" / "pictures"
BLOCKS = {(b.word, b.rest): b for b in blocks(PAGE)}
WHOLE, CODE = BLOCKS["file", "mine.yaml"], BLOCKS["file", "hands.py"]
FRAGMENTS = [b for b in blocks(PAGE) if (b.word, b.rest) == ("fragment", "mine.yaml")]


@pytest.fixture(autouse=True)
def hands(tmp_path_factory, monkeypatch):
    """The page's own function, to be imported."""
    folder = tmp_path_factory.mktemp("code")
    (folder / "hands.py").write_text(CODE.text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    yield
    sys.modules.pop("hands", None)


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda each: f"line {each.line}")
def test_a_choice_of_the_page_runs(fragment):
    config, chosen = yaml.safe_load(WHOLE.text), yaml.safe_load(fragment.text)
    assert chosen.keys() <= StableQpController.Parameters.model_fields.keys()
    config["parameters"].update(chosen)
    run = simulate("hoap3", config, duration=0.004)
    assert len(run.setpoints) == 4
    assert set(run.setpoints["solver_status"]) == {STATUS["certified"]}


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.svg")), ids=lambda path: path.stem)
def test_a_picture_carries_no_date_no_script_and_no_other_file(path):
    text = path.read_text(encoding="utf-8")
    assert "<dc:date>" not in text
    assert "matplotlib.org" not in text or "Matplotlib v" not in text
    for element in ET.fromstring(text).iter():
        assert not element.tag.endswith(("script", "image", "foreignObject"))
        for key, value in element.attrib.items():
            assert not key.endswith("href") or value.startswith("#")


@pytest.fixture
def studio(monkeypatch):
    """The modules that draw."""
    monkeypatch.syspath_prepend(str(FOLDER))
    before = set(sys.modules)
    import drawing
    import make

    yield make, drawing
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(FOLDER)):
            del sys.modules[name]


def test_every_picture_has_a_function_that_draws_it(studio):
    make, _ = studio
    assert sorted(make.PICTURES) == sorted(path.stem for path in FOLDER.glob("*.svg"))


def differences(drawing, old, new):
    """Curves that differ between two files, by their ids [points; pictures are 100 to 200 high].

    Processors round differently, and cusps and chatter show it: 0.6 and a sixth were seen.
    """
    committed, made = drawing.data(old), drawing.data(new)
    assert committed.keys() == made.keys()
    assert committed
    found = []
    for name, points in committed.items():
        if name.startswith("rough"):  # chatter: only the space that it takes is compared
            spans = [np.ptp(each, axis=0) for each in (points, made[name])]
            same = np.allclose(*spans, rtol=0.2, atol=2.0)
        else:
            same = points.shape == made[name].shape and np.allclose(points, made[name], atol=0.75)
        if not same:
            found.append(name)
    return found


def test_a_changed_curve_is_noticed(studio, tmp_path):
    _, drawing = studio
    old, new = FOLDER / "gamma.svg", tmp_path / "gamma.svg"
    text = old.read_text(encoding="utf-8")
    assert differences(drawing, old, old) == []
    name = next(iter(drawing.data(old)))
    x, y = re.search(rf'<g id="{name}">\s*<path d="M ([\d.]+) ([\d.]+)', text).groups()
    new.write_text(text.replace(f"M {x} {y}", f"M {x} {float(y) + 1.0}", 1), encoding="utf-8")
    assert differences(drawing, old, new) == [name]


@pytest.mark.long
@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.svg")), ids=lambda path: path.stem)
def test_a_picture_shows_what_runs_give_now(path, studio, tmp_path):
    make, drawing = studio
    assert differences(drawing, path, make.make(path.stem, tmp_path)) == []
