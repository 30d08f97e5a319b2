"""The robot at its start, worst and last tick: the right ones, of any log, and never too large."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_logs import active_log
from support.command_bench import inside
from support.html_page import Page
from support.log_samples import describe

from hoap3.robot_emulator.robots import available, load
from hoap3.tools.analysis.report.moments import Moment, moments
from hoap3.tools.analysis.report.motion import read_motion
from hoap3.tools.analysis.report.posture_views import posture_views
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.picture.body import Body

BOUND = 140_000  # bytes of all views; the page's own rules for them are 10,000 more


def views_of(log: Path):
    return posture_views(read_motion(Sources.open(log)))


def shown(drawing) -> list[str]:
    """What stands below each view."""
    page = Page(drawing.svg)
    return [view.all("p")[0].text() for view in page.root.all("div", "view")]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of short runs in lockstep, by controller."""
    folder = tmp_path_factory.mktemp("runs")
    found = {name: folder / name for name in ("qp12", "clik_sdp", "ghc")}
    for name, path in found.items():
        words = ("--controller", name, "--duration", 0.25, "--out", path)
        inside("run", "--lockstep", *words)
    return found


@pytest.fixture(scope="module")
def golden(logs):
    return read_motion(Sources.open(logs["qp12"]))


@pytest.mark.parametrize("run", ["qp12", "clik_sdp", "ghc"])
def test_a_log_has_a_view_of_its_start_its_end_and_its_worst_tick_if_that_differs(run, logs):
    (drawing,) = views_of(logs[run])
    texts = shown(drawing)
    assert [text.split()[0] for text in texts if text[0] != "w"] == ["start", "end"]
    assert "0.000 s" in texts[0]
    assert "0.249 s" in texts[-1]
    assert sum("worst" in text for text in texts) == 1
    drawn = Page(drawing.svg).root.all("svg")
    assert len(drawn) == len(texts)
    for svg in drawn:
        faces = [e for e in svg.all("path") if e.attributes["class"].startswith("c-body")]
        assert len(faces) > 10
        assert svg.all("circle")  # the point
    assert 5000 < len(drawing.svg) < BOUND


def test_the_moments_are_states_of_the_log(golden, logs):
    states = Sources.open(logs["qp12"]).main.states()
    for moment in golden.moments:
        (row,) = states[states["tick"] == moment.tick]
        assert moment.q == pytest.approx(row["q"], abs=0.0)
        assert moment.time_s == pytest.approx((row["stamp_intended"] - golden.start_ns) / 1e9)
    assert [golden.moments[0].tick, golden.moments[-1].tick] == states["tick"][[0, 249]].tolist()


def table(count: int, n: int = 2):
    rows = np.zeros(count, [("tick", "u8"), ("stamp_intended", "i8"), ("q", "f8", n)])
    rows["tick"] = np.arange(count) + 100
    rows["stamp_intended"] = 1_000_000 * np.arange(count) + 77
    return rows


def moments_of(v=None, margin=None, q=None, units=("m", "rad/s")) -> list[Moment]:
    """Of a robot whose joints move from −0.5 to 0.5 rad, or as `q` has them."""
    rows = table(50)
    rows["q"][:] = np.linspace(-0.5, 0.5, 50)[:, None] if q is None else q
    unknown = np.full(50, np.nan)
    known = [unknown if each is None else np.asarray(each, float) for each in (v, margin)]
    found = moments(rows, rows, *known, units, describe(2))
    assert [found[0].tick, found[-1].tick] == [100, 149]
    return found


def worst(**given) -> Moment:
    _, found, _ = moments_of(**given)
    assert found.name == "worst"
    return found


FALLING = 0.5 * np.linspace(0.2, 0.0, 50) ** 2
"""V of an error that falls from 0.2 to 0."""


def test_a_violated_margin_is_the_worst_of_all():
    margin = np.full(50, 0.3)
    margin[17] = -0.02
    found = worst(v=FALLING[::-1], margin=margin)
    assert found.tick == 117
    assert found.time_s == pytest.approx(0.017)
    assert "margin −0.0200 rad/s" in found.why


def test_else_an_error_that_is_larger_than_the_first():
    error = 0.2 + 0.1 * np.sin(np.linspace(0.0, 3.0, 50))
    found = worst(v=0.5 * error**2, margin=np.full(50, 0.3))
    assert found.tick == 100 + int(error.argmax())
    assert "300 mm" in found.why
    assert "mm" not in worst(v=0.5 * error**2, units=("", "")).why


def test_an_error_that_is_rounding_is_not_the_worst():
    v, margin = np.zeros(50), np.full(50, 0.3)
    v[20], margin[30] = 1e-30, 0.1
    assert worst(v=v, margin=margin).tick == 130


def test_else_the_smallest_margin_though_rounding_is_below_zero():
    margin = np.linspace(0.5, 0.1, 50)
    margin[30] = -1e-12
    assert worst(v=FALLING, margin=margin).tick == 130
    margin[30], margin[35] = np.inf, 0.05
    assert worst(v=FALLING, margin=margin).tick == 135


def test_a_smallest_margin_in_the_posture_of_the_start_is_no_picture_of_its_own():
    margin, q = np.linspace(0.1, 0.5, 50), np.zeros((50, 2))
    q[1:] += 0.001  # the same picture
    start, end = moments_of(v=FALLING, margin=margin, q=q)
    assert start.why.endswith("0.100 rad/s")
    assert end.why == ""
    margin[1] = 0.05
    assert "0.0500 rad/s at 0.001 s, tick 101" in moments_of(v=FALLING, margin=margin, q=q)[0].why
    q[23] = (0.1, -1.52)  # the joint that is nearest to a limit looks different
    assert worst(v=FALLING, margin=margin, q=q).tick == 123


def test_a_violated_margin_at_the_end_is_the_worst_although_others_look_different():
    margin, q = np.linspace(0.5, -0.1, 50), np.zeros((50, 2))
    q[23] = (0.1, -1.52)
    q[40:] = 0.3
    _, end = moments_of(v=FALLING, margin=margin, q=q)
    assert "violated" in end.why


def test_else_the_joint_that_is_nearest_to_a_limit():
    q = np.zeros((50, 2))
    q[23] = (0.1, -1.52)  # of −1.9 to 1.9
    found = worst(v=FALLING, q=q)
    assert found.tick == 123
    assert describe(2).joint_names[1] in found.why
    assert "10" in found.why


def test_joints_without_limits_are_near_to_none():
    robot = describe(2)
    rows = table(50)
    q = np.full((50, 2), np.nan)
    rows["q"] = q
    nothing = rows, q[:, 0], q[:, 0], ("", "")
    assert moments(rows, *nothing, robot) == []  # nothing is known of the joints, either


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_states_that_cannot_be_drawn_are_left_out(value, golden):
    rows = table(50)
    rows["q"][0] = value
    unknown = np.full(50, np.nan)
    found = moments(rows, rows, unknown, unknown, ("", ""), describe(2))
    assert "start" not in [moment.name for moment in found]
    base = np.array([value, 0, 0, 0, 0, 0, 1, *np.zeros(6)])
    beside = [replace(moment, base=base) for moment in golden.moments[:1]] + golden.moments[1:]
    with np.errstate(all="ignore"):
        (drawing,) = posture_views(replace(golden, moments=beside))
    assert len(shown(drawing)) == len(golden.moments) - 1
    assert posture_views(replace(golden, moments=[])) == []


BROKEN = [
    '<visual><geometry><box size="0 0 0"/></geometry></visual>',
    '<visual><geometry><box size="1e308 1 1"/></geometry></visual>',
    '<visual><geometry><sphere radius="-1"/></geometry></visual>',
    '<collision><origin xyz="1e200 0 0"/><geometry><sphere radius="1"/></geometry></collision>',
    "<visual/><collision><geometry/></collision>",
]


@pytest.mark.parametrize("shapes", BROKEN)
def test_broken_shapes_do_not_break_a_report(shapes, tmp_path):
    robot = describe(2)
    urdf = robot.urdf.replace('<link name="link_1">', f'<link name="link_1">{shapes}')
    log = active_log(tmp_path, count=5, description=robot.model_copy(update={"urdf": urdf}))
    (drawing,) = views_of(log)
    assert len(shown(drawing)) == 3
    assert not re.search(r"nan|inf|e\+", drawing.svg)


def test_a_free_base_is_drawn_where_it_is_and_stands_on_the_soles_that_touch(golden):
    robot = golden.description
    body = Body(robot)
    aside, still = np.array([0.3, -0.1, 0.0]), np.array([0.0, 0.0, 0.0, 1.0, *np.zeros(6)])
    standing = []
    for moment in golden.moments:
        placed = body.place(moment.q)  # on its right sole
        root = placed.origins[placed.frames[robot.structure.root]]
        assert placed.rotations[placed.frames[robot.structure.root]] == pytest.approx(
            np.eye(3), abs=1e-2
        )
        standing.append(replace(moment, base=np.concatenate((root + aside, still))))
    (drawing,) = posture_views(replace(golden, moments=standing))
    assert len(shown(drawing)) == len(standing)
    assert 'class="c-support"' in drawing.svg
    up = np.array([0.0, 0.0, 0.1, *np.zeros(10)])
    lifted = [replace(moment, base=moment.base + up) for moment in standing]
    (above,) = posture_views(replace(golden, moments=lifted))
    assert 'class="c-support"' not in above.svg


@pytest.mark.slow
def test_of_a_robot_of_very_many_shapes_the_report_stays_small(tmp_path):
    robot = describe(40)
    shape = '<visual><origin xyz="{} {} {}"/><geometry><{}/></geometry></visual>'
    kinds = ('cylinder radius="0.1" length="0.3"', 'sphere radius="0.1"', 'box size=".2 .3 .1"')
    rng, urdf = np.random.default_rng(0), robot.urdf
    for place in range(41):
        made = "".join(shape.format(*rng.normal(size=3), kinds[k % 3]) for k in range(9))
        urdf = urdf.replace(f'<link name="link_{place}">', f'<link name="link_{place}">{made}')
    log = active_log(tmp_path, count=3, description=robot.model_copy(update={"urdf": urdf}))
    (drawing,) = views_of(log)
    assert len(drawing.svg.encode()) < BOUND
    assert "left out" in drawing.figures


@pytest.mark.slow
@pytest.mark.parametrize("name", available())
def test_of_a_shipped_robot_in_any_posture_the_report_stays_small(name, tmp_path):
    margins = {"margin": 1.0}, {"margin": -1.0}, {"margin": 1.0}
    log = active_log(tmp_path, count=3, description=load(name), setpoint=margins.__getitem__)
    (drawing,) = views_of(log)
    assert len(drawing.svg.encode()) < BOUND
    assert len(shown(drawing)) == 3
