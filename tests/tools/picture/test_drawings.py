"""An SVG and an image have what was to be drawn, where it was to be."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.html_page import Page

from docs.pictures.readme.canvas import Canvas
from hoap3.remote_controller.constraints.support.polygon import hull
from hoap3.robot_emulator.robots import load
from hoap3.tools.picture.body import Body
from hoap3.tools.picture.marks import Floor, Marks
from hoap3.tools.picture.palette import COLOURS
from hoap3.tools.picture.stage import Stage
from hoap3.tools.picture.svg import FINE, Flat, svg

SQUARE = np.array([[10.0, 10.0], [40.0, 10.0], [40.0, 30.0], [10.0, 30.0]])


def corners(path: str) -> np.ndarray:
    """Places of a path of relative steps [px]."""
    found = re.fullmatch(r"M(.*)l([^Mz]*)z?", path)
    steps = np.array(re.findall(r"-?\d+", f"{found[1]} {found[2]}"), float).reshape(-1, 2)
    return np.cumsum(steps, axis=0) / FINE


def rgb(role: str, dark: bool = False) -> tuple[int, ...]:
    return tuple(bytes.fromhex(COLOURS[role][dark][1:]))


def test_every_corner_is_within_a_step_of_where_it_should_be():
    points = np.random.default_rng(0).uniform(-50, 400, (9, 2))
    drawn = Page(svg([Flat("face", points, "body3"), Flat("line", points, "red")], 300, 200))
    assert drawn.root.all("svg")[0].attributes["viewbox"] == f"0 0 {300 * FINE} {200 * FINE}"
    face, line = drawn.root.all("path")
    assert face.attributes["class"] == "c-body3"
    assert line.attributes["class"].split() == ["l", "c-red"]
    for path in (face, line):
        assert np.abs(corners(path.attributes["d"]) - points).max() <= 0.5 / FINE + 1e-9


def test_faces_of_one_colour_become_one_path_in_their_places():
    shown = ((0.0, "body1"), (50.0, "body1"), (0.0, "body2"))
    faces = [Flat("face", SQUARE + shift, role) for shift, role in shown]
    both, single = Page(svg(faces, 100, 100)).root.all("path")
    parts = re.findall(r"M[^M]*", both.attributes["d"])
    assert corners(parts[0]) == pytest.approx(SQUARE)
    assert corners(parts[1]) == pytest.approx(SQUARE + 50)
    assert corners(single.attributes["d"]) == pytest.approx(SQUARE)


def test_a_role_that_no_page_has_is_refused():
    with pytest.raises(KeyError):
        svg([Flat("face", SQUARE, "nobody")], 50, 50)


@pytest.mark.parametrize("dark", [False, True])
def test_an_image_has_the_colours_of_its_scheme(dark):
    canvas = Canvas(50, 40, dark=dark)
    canvas.paint([Flat("face", SQUARE, "green"), Flat("dot", SQUARE[:1], "red", 4.0)])
    image = canvas.image
    assert image.size == (50, 40)
    assert image.getpixel((25, 20)) == rgb("green", dark)
    assert image.getpixel((10, 10)) == rgb("red", dark)
    assert image.getpixel((2, 2)) == rgb("card", dark)


@pytest.mark.parametrize("form", ["line", "loop", "dash", "ring", "cross"])
def test_marks_are_painted_along_their_lines(form):
    canvas = Canvas(50, 40)
    size = 6.0 if form in {"ring", "cross"} else 3.0
    canvas.paint([Flat(form, SQUARE, "blue", size)])
    place = {"ring": (15, 10), "cross": (14, 10)}.get(form, (12, 10))
    assert canvas.image.getpixel(place) == rgb("blue")
    closing = canvas.image.getpixel((10, 20)) == rgb("blue")
    assert closing == (form == "loop")


def test_text_is_painted():
    canvas = Canvas(80, 30)
    canvas.write((5, 20), "0.1 m", "ink", 14.0)
    assert np.asarray(canvas.image.convert("L")).min() < 120


def test_a_shadow_is_as_large_as_the_box_above_it():
    floor = Floor.below(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 2.0]]))
    body = Body(load("hoap3"))
    placement = body.place(load("hoap3").initial_position)
    stage = Stage.around(body, [placement], [], (300, 300), 10)
    shadows = floor.shadows(body.faces(placement), stage.camera)
    assert len(shadows) == len(body.solids)
    assert {each.role for each in shadows} == {"shadow"}
    first = [f.corners[:, :2] for f in body.faces(placement) if f.index == 0]
    flat = hull(np.concatenate(first))
    expected = stage.camera.project(np.column_stack((flat, np.zeros(len(flat)))))
    assert shadows[0].points == pytest.approx(expected)


def test_a_hull_is_convex_and_holds_every_point():
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(5).normal(size=(60, 2)).round(1)
    found = hull(points)
    reference = points[ConvexHull(points).vertices]
    assert {tuple(each) for each in found} == {tuple(each) for each in reference}
    x, y = found.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(ConvexHull(points).volume)  # positive: it turns left


@pytest.mark.parametrize("lowest", [0.0, -0.002, -0.4, 0.3])
def test_a_floor_is_under_the_robot_and_never_above_its_base(lowest):
    points = np.array([[0.1, -0.3, lowest], [0.9, 0.4, 1.0]])
    floor = Floor.below(points)
    assert floor.height == (-0.4 if lowest == -0.4 else 0.0)  # 2 mm of a metre are no step
    assert (floor.low < points[0, :2]).all()
    assert (floor.high > points[1, :2]).all()
    assert floor.square == pytest.approx(0.2)


def test_marks_are_seen_through_the_robot_and_a_plumb_line_ends_on_the_floor():
    body = Body(load("hoap3"))
    placement = body.place(load("hoap3").initial_position)
    marks = Marks(
        point=np.array([0.0, 0.02, 0.25]),
        target=np.array([0.01, 0.03, 0.28]),
        path=np.array([[0.0, 0.0, 0.2], [0.0, 0.02, 0.25]]),
        support=np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]),
        plumb=True,
    )
    stage = Stage.around(body, [placement], [marks], (300, 300), 10)
    drawn = stage.paint(placement, marks)
    last_face = max(k for k, each in enumerate(drawn) if each.role.startswith("body"))
    over = [each.form for each in drawn[last_face + 1 :] if not each.role.startswith("body")]
    assert over == ["loop", "line", "dash", "dot", "ring", "cross", "dot", "dot"]
    dash = next(each for each in drawn if each.form == "dash")
    ground = np.array([0.0, 0.02, stage.floor.height])
    assert dash.points[1] == pytest.approx(stage.camera.project(ground))
    (area,) = [each for each in drawn if each.role == "support"]
    assert len(area.points) == 3


def test_a_robot_without_shapes_is_drawn_by_its_bones():
    description = load("ur5")
    body = Body(description, solids=[])
    placement = body.place(description.initial_position)
    stage = Stage.around(body, [placement], [], (300, 300), 10)
    lines = [each for each in stage.paint(placement, Marks()) if each.role == "soft"]
    assert len(lines) == len(description.structure.joints)
    ends = stage.camera.project(placement.origins)
    for line, joint in zip(lines, description.structure.joints, strict=True):
        here = [placement.frames[joint.parent], placement.frames[joint.child]]
        assert line.points == pytest.approx(ends[here])
