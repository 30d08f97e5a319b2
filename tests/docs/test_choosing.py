"""docs/choosing.md: every choice runs; every picture is on a page, and is what the code gives."""

from __future__ import annotations

import re
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from pages import HOUSE, blocks, page, table

from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.lyapunov_qp.stable_qp import StableQpController
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp import stable_qp
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS
from hoap3.remote_controller.tasks import status as task_status
from hoap3.robot_emulator.robots import load
from hoap3.tools.simulate import simulate

PAGE = "choosing.md"
FOLDER = HOUSE / "docs" / "pictures"
FRAGMENTS = [b for b in blocks(PAGE) if b.language == "yaml" and not b.word]
WHOLE = next(b for b in blocks(PAGE) if b.word == "file")
CODE = next(b for b in blocks(PAGE) if b.language == "python")


@pytest.fixture(autouse=True)
def hands(tmp_path_factory, monkeypatch):
    """The page's own function, to be imported."""
    folder = tmp_path_factory.mktemp("code")
    (folder / "hands.py").write_text(CODE.text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    yield
    sys.modules.pop("hands", None)


SHOWN = re.compile(r"^!\[(?P<alt>[^\]]+)\]\(pictures/(?P<name>\w+)\.svg\)\n(?P<next>.*)$", re.M)


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda each: f"line {each.line}")
def test_a_choice_of_the_page_runs(fragment):
    config, chosen = yaml.safe_load(WHOLE.text), yaml.safe_load(fragment.text)
    assert chosen.keys() <= StableQpController.Parameters.model_fields.keys()
    config["parameters"].update(chosen)
    run = simulate("hoap3", config, duration=0.004)
    assert len(run.setpoints) == 4
    assert set(run.setpoints["solver_status"]) == {STATUS["certified"]}


def test_every_objective_is_among_the_choices_and_constraints_have_headings():
    chosen = [yaml.safe_load(each.text) for each in FRAGMENTS]
    used = {entry["constraint"] for each in chosen for entry in each.get("constraints", ())}
    kinds = {each["objective"]["kind"] for each in chosen if "objective" in each}
    assert kinds == {"qp12", "lp", "least_squares"}
    for heading in used:
        assert f"\n### {heading}\n" in page(PAGE)


def minimal(name: str) -> Constraint:
    """A constraint as the page's own blocks have it."""
    entries = [
        entry
        for each in FRAGMENTS
        for entry in yaml.safe_load(each.text).get("constraints", ())
        if entry["constraint"] == name
    ]
    robot = load("hoap3")
    from hoap3.remote_controller.model.kinematics import Kinematics

    entry = entries[-1] if entries else {"constraint": name}
    settings = [constraints.ConstraintSettings.model_validate(entry)]
    serves = constraints.find(name).serves("velocity")
    build = constraints.build if serves else constraints.build_accelerations
    return build(settings, robot, Kinematics(robot), robot.period_s).constraints[0]


@pytest.mark.parametrize("row", table(PAGE, "Constraints, one by one"), ids=lambda r: r["it keeps"])
def test_the_table_of_constraints_is_as_the_code_has_it(row):
    constraint = minimal(row["`constraint`"].strip("`"))
    listed = set(re.findall(r"`(\w+)`", row["events, beside `outside` and `started_outside`"]))
    assert listed | {"outside", "started_outside"} == constraint.events.keys()
    assert (row["unit of its margin"] == "–") == (not constraint.margins.size)
    assert row["rows"].startswith("none") == (constraint.rows == 0)
    assert ("equation" in row["rows"]) == constraint.equality


def test_every_status_path_form_and_column_is_explained():
    rows = table(PAGE, "When something is impossible")  # conditions come first
    assert rows[0]["condition"] == "`slowed`"
    text = page(PAGE)
    listed = dict(re.findall(r"^\| (\d+) \| `(\w+)` \|", text, flags=re.M))
    for number, name in enumerate(status.NAMES):
        assert f"`{name}`" in text
        assert listed.get(str(number), name) == name
    paths = table(PAGE, "What certified means here")
    assert {int(row["`solver_path`"]): row["name"] for row in paths} == dict(
        enumerate(stable_qp.PATHS)
    )
    forms = table(PAGE, "Ψ: how fast V falls")
    assert tuple(row["`form`"].strip("`") for row in forms) == FORMS
    for name in (*StableQpController.extra_names, *task_status.NAMES[1:]):
        assert f"`{name}`" in text


def test_every_picture_is_shown_once_with_a_caption():
    pages = [page(name) for name in (PAGE, "priorities.md", "gains.md")]
    shown = [each for text in pages for each in SHOWN.finditer(text)]
    files = {path.stem for path in FOLDER.glob("*.svg")}
    assert sorted(each["name"] for each in shown) == sorted(files)
    assert sum(len(re.findall(r"!\[", text)) for text in pages) == len(shown)
    for each in shown:
        assert len(each["alt"].split()) >= 5, each["name"]
        assert each["next"].startswith("*"), each["name"]
        assert len(each["next"].split()) >= 5, each["name"]


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
    old, new = FOLDER / "rates.svg", tmp_path / "rates.svg"
    text = old.read_text(encoding="utf-8")
    assert differences(drawing, old, old) == []
    name = next(iter(drawing.data(old)))
    x, y = re.search(rf'<g id="{name}">\s*<path d="M ([\d.]+) ([\d.]+)', text).groups()
    new.write_text(text.replace(f"M {x} {y}", f"M {x} {float(y) + 1.0}", 1), encoding="utf-8")
    assert differences(drawing, old, new) == [name]


def test_the_same_picture_twice_is_the_same_bytes(studio, tmp_path):
    make, _ = studio
    (tmp_path / "second").mkdir()
    first, second = make.make("weights", tmp_path), make.make("weights", tmp_path / "second")
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.svg")), ids=lambda path: path.stem)
def test_a_picture_shows_what_runs_give_now(path, studio, tmp_path):
    make, drawing = studio
    assert differences(drawing, path, make.make(path.stem, tmp_path)) == []
