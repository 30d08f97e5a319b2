"""Ten tasks of an operator on the live page, each with the keyboard alone and by touch alone."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from operator_hands import LEAST_PX, PHONE, SHOWN, WIDE, Keyboard, Touch
from page_bench import frame, hello, made_up_view, poses

from hoap3.tools.analysis.report.page import write_report
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_lockstep

pytestmark = pytest.mark.slow

STILL = poses(0.0)
ASIDE = [0.3, 0.1, 0.5]
ARM = {"name": "arm", "kind": "posture", "frame": None, "reference": None, "joints": [1, 2]}
TARGETS = [*hello()["targets"], ARM]
still = partial(frame, poses=STILL, targets=[STILL[3], ASIDE, [0.0] * 6, [0.8, 0.0]])

SMALL = """least => [...document.querySelectorAll("button, input, select, summary")]
  .filter((each) => each.checkVisibility())
  .map((each) => [each.outerHTML, each.offsetWidth, each.offsetHeight])
  .filter(([, width, height]) => Math.min(width, height) < least)"""


@pytest.fixture
def view():
    with made_up_view(frames=still, targets=TARGETS) as made:
        yield made


@pytest.fixture(params=[Keyboard, Touch], ids=["keyboard", "touch"])
def open_with(request, open_page):
    """Opens a page, and returns what operates it."""

    def opened(view):
        page = open_page(view, **request.param.options)
        page.wait_for_function("() => hoap3.proved && hoap3.drawn.length > 3")
        return request.param(page, view)

    return opened


@pytest.fixture
def hand(open_with, view):
    """Of the operator."""
    hand = open_with(view)
    hand.press(hand.button("Steer"))
    hand.page.wait_for_selector("#steer[aria-pressed=true]")
    return hand


def test_read_the_tool_pose(open_with, view):
    hand = open_with(view)
    rows = hand.page.get_by_role("group", name="hand", exact=True).get_by_role("row")
    for name, expected in zip(["x [m]", "y [m]", "z [m]"], STILL[3][:3], strict=True):
        row = rows.filter(has_text=name)
        hand.see(row)
        shown = row.get_by_role("cell").first.inner_text()
        assert float(shown) == pytest.approx(expected, abs=1e-4)


def test_enter_a_target_pose(hand):
    group = hand.page.get_by_role("group", name="hand", exact=True)
    entered = {"x": 0.25, "y": -0.1, "z": 0.5, "roll": 0, "pitch": 0, "yaw": 90}
    for axis, value in entered.items():
        hand.enter(group.get_by_label(f"Target hand {axis}", exact=True), value)
    hand.press(group.get_by_role("button", name="Move to target"))
    do = hand.wait_for("place")[0]
    assert do["name"] == "hand"
    assert do["values"] == pytest.approx([0.25, -0.1, 0.5, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])


def test_drag_a_target(hand):
    name, moved = hand.drag_aside()
    hand.wait_for("drop")
    assert name == "aside"
    assert moved[0] > 0.01
    assert moved[1:] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_jog_a_joint(hand):
    hand.raise_slider(hand.page.get_by_role("slider", name="lift"))
    hand.wait_for("drop")
    do = hand.wait_for("target")[-1]
    assert do["name"] == "arm"
    assert do["values"][0] > 0.8
    assert do["values"][1] == 0.0  # the other joint stays


def test_rotate_the_target(hand):
    with hand.driving("Rotate ↺ z"):
        do = hand.wait_for("velocity", 3)[-1]
    hand.wait_for("drop")
    assert do["name"] == "hand"
    assert np.flatnonzero(do["values"]).tolist() == [5]
    assert do["values"][5] > 0.0


def test_see_which_joint_is_near_a_limit(open_with, view):
    hand = open_with(view)
    joints = hand.page.get_by_role("region", name="Joints", exact=True).get_by_role("listitem")
    near = joints.filter(has_text="▲")
    hand.see(near)
    assert near.inner_text().split()[:3] == ["lift", "▲", "1.79"]


def test_stop(hand):
    """Also while a field is edited."""
    hand.enter(hand.page.get_by_label("Target hand x", exact=True), 0.3)
    hand.stop()
    hand.wait_for("stop")
    assert hand.view.verbs()[-1] == "stop"


def test_recover(open_with):
    stopped = partial(still, mode="stopped", stop_reason="holder_lost")
    with made_up_view(frames=stopped) as view:
        hand = open_with(view)
        hand.see(hand.page.locator("#mode", has_text="holder_lost"))
        hand.press(hand.button("Recover"))
        hand.wait_for("recover")
        assert view.verbs() == ["recover"]


def test_change_a_gain(open_with, view):
    hand = open_with(view)
    hand.raise_slider(hand.page.get_by_role("slider", name="γ"))
    assert hand.wait_for("change")[0]["what"]["gamma"] > 1.0
    hand.enter(hand.page.get_by_role("spinbutton", name="gain"), 25.5)
    hand.page.keyboard.press("Enter")
    assert hand.wait_for("change", 2)[-1]["what"] == {"kp": 25.5}


def test_find_why_the_run_failed(open_with):
    words = "hand 12.5 mm (tolerance 1 mm); certified 2875 of 3000 answers; late 17, lost 3"
    verdicts = {"task": {"verdict": "fail", "words": words}}
    with made_up_view(frames=partial(still, verdicts=verdicts)) as view:
        hand = open_with(view)
        shown = hand.page.get_by_role("region", name="Verdicts", exact=True)
        failed = shown.get_by_role("listitem").filter(has_text="fail")
        hand.see(failed)
        assert failed.inner_text().split("\n")[1:] == ["Task", "fail", words]


@pytest.mark.parametrize("options", [WIDE, PHONE], ids=["wide", "phone"])
def test_the_first_line_of_a_report_names_what_failed(browser, tmp_path, options):
    emulator, _ = load_emulator_config("hoap3", [])
    controller, _ = load_controller_config("qp12", [])
    run_lockstep(emulator, controller, 0.05, tmp_path / "run")
    report = write_report(tmp_path / "run", verify=False)["report"]
    with browser.new_context(**options) as context:
        page = context.new_page()
        page.goto(f"file://{report}")
        first = page.locator("p").first
        assert first.evaluate(SHOWN)
        assert first.inner_text().startswith("Failed: task (")


def test_whatever_a_finger_presses_is_large_enough(open_page, view):
    view.operator = "me"
    page = open_page(view, **PHONE)
    page.wait_for_selector("#steer[aria-pressed=true]")
    assert page.evaluate(SMALL, LEAST_PX) == []


@pytest.mark.parametrize("name", ["Speed", "lift", "γ"])
def test_a_swipe_that_begins_on_a_slider_commands_nothing(open_page, view, name):
    view.operator = "me"
    hand = Touch(open_page(view, **PHONE), view)
    hand.page.wait_for_selector("#steer[aria-pressed=true]")
    slider = hand.page.get_by_role("slider", name=name)
    before, (x, y) = slider.input_value(), hand.place(slider, 0.8)
    hand.move_finger((x, y), (x + 5, y + 150))
    hand.fingers("touchEnd")
    hand.stop()
    hand.wait_for("stop")
    assert view.verbs() == ["stop"]
    assert slider.input_value() == before
