"""What the page asks for, and that it lets go."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from page_bench import frame, made_up_view, poses

pytestmark = pytest.mark.slow
STILL = poses(0.0)


# A robot that stands, so that a gizmo stays under the mouse:
still = partial(frame, poses=STILL, targets=[STILL[3], [0.3, 0.1, 0.5], [0.0] * 6])


@pytest.fixture
def view():
    with made_up_view(frames=still) as made:
        yield made


@pytest.fixture
def page(steer, view):
    """One that steers."""
    return steer(view)


def grab(page, name, pixels=60, steps=12):
    """Pull a gizmo along x, and keep the button down."""
    page.wait_for_function("() => hoap3.drawn.length > 5")
    found = page.evaluate("name => hoap3.gizmo(name)", name)
    (x0, y0), (x, y) = found["centre"], found["handle"]
    length = np.hypot(x - x0, y - y0)
    page.mouse.move(x, y)
    page.mouse.down()
    for i in range(1, steps + 1):
        far = pixels * i / steps
        page.mouse.move(x + far * (x - x0) / length, y + far * (y - y0) / length)
    page.wait_for_function("() => hoap3.acting === 'drag'")


def wait_for(page, view, verb, count=1):
    """Until the server has been asked for it."""
    for _ in range(200):
        if view.verbs().count(verb) >= count:
            return
        page.wait_for_timeout(25)
    pytest.fail(f"the page never asked to {verb}: {view.verbs()}")


def no_more(page, view, kind):
    """That nothing of a kind comes for half a second."""
    page.wait_for_timeout(100)
    before = len(view.heard(kind))
    page.wait_for_timeout(500)
    assert len(view.heard(kind)) == before


def targets(view, verb="target"):
    return [(at_s, do) for at_s, do in view.asked if do["verb"] == verb]


def test_joints_of_a_posture_have_sliders_that_drop_it_when_let_go(steer):
    told = {"name": "arm", "kind": "posture", "frame": None, "reference": None, "joints": [1, 2]}
    stands = partial(frame, targets=[[0.8123, 9.0]])
    with made_up_view(targets=[told], frames=stands) as view:
        page = steer(view)
        lift, roll = page.locator("#postures input").all()
        roll.focus()
        page.keyboard.down("ArrowRight")
        wait_for(page, view, "target")
        assert "drop" not in view.verbs()
        page.keyboard.up("ArrowRight")
        wait_for(page, view, "drop")
        box = lift.bounding_box()
        page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
        page.mouse.down()
        wait_for(page, view, "target", 2)
        page.evaluate("window.dispatchEvent(new Event('blur'))")
        wait_for(page, view, "drop", 2)
        page.mouse.up()
        first, *_, last = [do for _, do in targets(view)]
        assert first["name"] == "arm"
        assert first["values"][0] == 0.8123  # the other one stays where it is
        assert 0.0 < first["values"][1] - 9.0 < 0.1
        assert last["values"] == pytest.approx([1.3, 9.0], abs=0.1)  # from −0.2 to 1.8; where it is
        page.click("#steer")
        page.wait_for_selector("#move", state="hidden")


@pytest.mark.parametrize(("name", "selected"), [("hand", False), ("aside", False), ("hand", True)])
def test_a_drag_sends_targets_and_letting_go_drops_them(page, view, name, selected):
    """Also where all is selected, which the browser would drag, and cancel the pointer."""
    if selected:
        page.keyboard.press("Control+a")
    grab(page, name)
    page.wait_for_timeout(300)  # several beats
    assert "drop" not in view.verbs()
    page.mouse.up()
    wait_for(page, view, "drop")
    sent = targets(view)
    assert {do["name"] for _, do in sent} == {name}
    assert view.verbs()[-1] == "drop"
    no_more(page, view, "act")
    start = {"hand": np.array(STILL[3]), "aside": np.array([0.3, 0.1, 0.5])}[name]
    moved = np.array(sent[-1][1]["values"]) - start
    # The base stands turned by nothing, so its axes are those of the world.
    assert abs(moved[0]) > 0.01
    assert np.abs(np.delete(moved, 0)).max() < 1e-6


@pytest.mark.parametrize("name", ["hand", "aside"])
def test_numbers_that_are_not_dragged_stay_exactly_as_they_were_sent(steer, name):
    """A robot at rest is a little beside its target, and frames are rounded."""
    near = np.array([4e-4, -2e-5, 1.23456789e-5])
    asked = [*(np.array([0.3, 0.1, 0.5]) + near).tolist()]
    if name == "hand":  # the other quaternion of the same orientation
        asked = [*(np.array(STILL[3][:3]) + near).tolist(), *(-each for each in STILL[3][3:])]
    with made_up_view(frames=partial(still, asked={name: asked})) as view:
        page = steer(view)
        grab(page, name)
        page.mouse.up()
        wait_for(page, view, "drop")
        sent = np.array([do["values"] for _, do in targets(view)])
        assert abs(sent[-1][0] - asked[0]) > 0.01
        assert sent[:, 1:].tolist() == [asked[1:]] * len(sent)


def test_a_drag_begins_where_the_robot_is_if_that_is_far_from_what_was_sent(steer):
    asked = {"aside": [0.3, 0.2, 0.5]}
    with made_up_view(frames=partial(still, asked=asked)) as view:
        page = steer(view)
        grab(page, "aside")
        page.mouse.up()
        wait_for(page, view, "drop")
        assert {tuple(do["values"][1:]) for _, do in targets(view)} == {(0.1, 0.5)}


@pytest.mark.long  # it needs the machine for itself
def test_a_page_that_steers_says_40_times_a_second_that_it_lives(steer):
    with made_up_view() as view:
        page = steer(view)
        before = len(view.heard("beat"))
        page.wait_for_timeout(1000)
        assert 30 <= len(view.heard("beat")) - before <= 44
        page.click("#steer")
        page.wait_for_selector("#steer[aria-pressed=false]")
        no_more(page, view, "beat")


def test_a_page_that_computes_without_end_says_nothing(page, view):
    """Its worker goes on; what is sent is sent by the page."""
    page.wait_for_timeout(200)
    with page.expect_event("console"):
        page.evaluate("""setTimeout(() => {
          console.log("busy");
          const end = performance.now() + 1500;
          while (performance.now() < end);
        })""")
    before = len(view.heard("beat"))
    view.wait(1.0)
    assert len(view.heard("beat")) - before <= 1
    page.wait_for_function("() => true")


def test_targets_are_sent_30_times_a_second_at_most(page, view):
    grab(page, "hand", steps=120)
    page.mouse.up()
    wait_for(page, view, "drop")
    stamps = [at_s for at_s, _ in targets(view)]
    assert len(stamps) - 1 <= 30 * (stamps[-1] - stamps[0]) + 2  # the last is sent at once


def test_the_numbers_are_in_the_axes_of_the_reference(steer):
    """Pulled along the world's x, seen from a base that is turned by 90°."""
    half = np.sqrt(0.5)
    turned = [[0.1, 0.2, 0.0, 0.0, 0.0, half, half], *STILL[1:]]
    frames = partial(frame, poses=turned, targets=[None, [0.3, 0.1, 0.5], None])
    with made_up_view(frames=frames) as view:
        page = steer(view)
        grab(page, "aside")
        page.mouse.up()
        wait_for(page, view, "drop")
        moved = np.array(targets(view)[-1][1]["values"]) - [0.3, 0.1, 0.5]
        assert abs(moved[1]) > 0.01
        np.testing.assert_allclose(moved[[0, 2]], 0.0, atol=1e-6)


@pytest.mark.parametrize(
    "lost",
    [
        "dispatchEvent(new Event('blur'))",
        "document.dispatchEvent(new Event('visibilitychange'))",
        (
            "document.querySelector('#stage canvas').dispatchEvent("
            "new PointerEvent('pointercancel', { pointerId: 1 }))"
        ),
    ],
)
def test_a_page_that_loses_the_hand_lets_go(page, view, lost):
    grab(page, "hand")
    page.evaluate(lost)
    wait_for(page, view, "drop")
    no_more(page, view, "act")
    assert page.evaluate("hoap3.acting") is None


def test_who_is_not_the_operator_any_more_drags_no_more(page, view):
    grab(page, "hand")
    view.operator = "other"
    wait_for(page, view, "drop")
    no_more(page, view, "beat")
    page.mouse.move(300, 300)
    no_more(page, view, "act")


@pytest.mark.parametrize("how", ["button", "Escape", "Space", "Space on another button"])
def test_stop_stops(open_page, how):
    with made_up_view() as view:
        page = open_page(view)
        page.wait_for_selector("#stop:enabled")
        if how == "button":
            page.click("#stop")
        else:
            if " on " in how:
                page.focus("#steer")
            page.keyboard.press(how.partition(" ")[0])
        wait_for(page, view, "stop")
        assert view.verbs() == ["stop"]


def test_only_a_stopped_robot_can_be_recovered(open_page):
    with made_up_view() as view:
        page = open_page(view)
        page.wait_for_selector("#steer:enabled")
        assert page.locator("#recover").is_disabled()


def test_a_pose_that_is_entered_becomes_the_target(page, view):
    quarter = np.sqrt(0.5)
    for axis, value in {"x": 0.25, "y": -0.1, "z": 0.5, "roll": 0, "pitch": 0, "yaw": 90}.items():
        page.fill(f"[aria-label='Target hand {axis}']", str(value))
    page.locator(".pose", has_text="hand").locator("text=Move to target").click()
    wait_for(page, view, "place")
    ((_, do),) = targets(view, "place")
    assert do["name"] == "hand"
    assert do["values"] == pytest.approx([0.25, -0.1, 0.5, 0.0, 0.0, quarter, quarter])


def test_the_target_shown_is_the_one_sent_last_unless_another_is_being_entered(steer):
    aside = [0.3, 0.1, 0.5]
    moved = partial(still, asked={"aside": aside})
    with made_up_view(frames=moved) as view:
        page = steer(view)
        x = "[aria-label='Target aside x']"
        page.wait_for_function("x => document.querySelector(x).value === '0.3000'", arg=x)
        aside[0] = 0.7  # dragged there
        page.wait_for_function("x => document.querySelector(x).value === '0.7000'", arg=x)
        page.fill(x, "0.9")
        aside[0] = 0.8
        page.evaluate("() => new Promise((next) => setTimeout(next, 300))")
        assert page.input_value(x) == "0.9"


def test_no_pose_is_entered_while_the_robot_is_stopped(steer):
    stopped = partial(still, mode="stopped")
    with made_up_view(frames=stopped) as view:
        page = steer(view)
        page.wait_for_selector("#recover:enabled")
        assert page.locator(".pose", has_text="hand").locator("text=Move to target").is_disabled()
        assert "Recover" in page.inner_text("#note")


def test_an_empty_field_sends_nothing_and_the_pose_now_can_be_copied(page, view):
    field = "[aria-label='Target aside x']"
    page.fill(field, "")
    aside = page.locator(".pose", has_text="aside")
    aside.locator("text=Move to target").click()
    aside.locator("text=Copy current").click()
    assert float(page.input_value(field)) == pytest.approx(0.3)
    assert "place" not in view.verbs()


def test_angles_of_a_pose_are_roll_pitch_and_yaw_of_a_urdf(open_page, view):
    page = open_page(view)
    there_and_back = """async () => {
      const { quaternion, rollPitchYaw } = await import("./poses.js");
      return [quaternion([20, -35, 110]), rollPitchYaw(quaternion([20, -35, 110]))];
    }"""
    values, angles = page.evaluate(there_and_back)
    rotation = pin.rpy.rpyToMatrix(*np.radians([20, -35, 110]))
    assert values == pytest.approx(pin.Quaternion(rotation).coeffs().tolist())
    assert angles == pytest.approx([20, -35, 110])


def test_a_phone_has_buttons_to_rotate_and_no_hints_for_keys(steer, view):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    page = steer(view, **phone)
    assert page.locator("#arrows button:visible").count() == 12
    assert page.locator("kbd:visible").count() == 0
    page.select_option("#drive-target", "aside")  # a position
    assert page.locator("#arrows button:visible").count() == 6


def test_recover_steer_and_release_are_asked_for(open_page):
    with made_up_view(frames=lambda tick: frame(tick, mode="stopped")) as view:
        page = open_page(view)
        page.click("#recover:enabled")
        page.click("#steer")
        page.wait_for_selector("#steer[aria-pressed=true]")
        page.click("#steer")
        page.wait_for_selector("#steer[aria-pressed=false]")
        assert view.verbs() == ["recover", "acquire", "release"]
        view.error = "someone else steers"
        page.click("#steer")
        page.wait_for_selector("#note.refused")
        assert "someone else steers" in page.inner_text("#note")


@pytest.mark.parametrize("token", ["", "not-the-token"])
def test_a_page_without_the_token_sends_nothing(open_page, token):
    with made_up_view(frames=still) as view:
        view.operator = "me"  # whatever a server says
        page = open_page(view, token)
        page.wait_for_selector("#note:has-text('token')")
        for key in ("Escape", "Space", "Shift+w"):
            page.keyboard.press(key)
        for button in ("recover", "steer", "dead-man"):
            assert page.locator(f"#{button}").is_disabled()
            page.click(f"#{button}", force=True)
        page.click("#stop")
        page.wait_for_selector("#note.refused:has-text('hoap3 stop made up')")
        assert page.locator("#pose input:enabled").count() == 0
        at = page.evaluate("hoap3.gizmo('hand')")
        page.mouse.move(*at["handle"])
        page.mouse.down()
        page.mouse.move(300, 200)
        page.mouse.up()
        assert page.locator("#sliders input:enabled").count() == 0
        page.wait_for_timeout(300)
        told = [each["kind"] for each in view.taken if each["kind"] != "drawn"]  # what it looks at
        assert told == (["prove"] if token else [])


def test_a_slider_is_sent_when_it_is_let_go(page, view):
    assert page.locator("#sliders .setting").count() == 3
    assert page.locator("#sliders input").count() == 2  # what is no number is only shown
    gamma = page.locator("#sliders input[type=range]")
    gamma.scroll_into_view_if_needed()
    box = gamma.bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 0.3, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.5, middle, steps=5)
    page.wait_for_timeout(200)
    assert "change" not in view.verbs()
    page.mouse.up()
    wait_for(page, view, "change")
    ((_, do),) = targets(view, "change")
    assert do["what"]["gamma"] == pytest.approx(2.55, abs=0.1)  # half way from 0.1 to 5
    view.error = "too fast"
    page.mouse.click(box["x"] + box["width"] * 0.9, middle)
    page.wait_for_selector("#sliders:has-text('too fast')")
    assert float(gamma.input_value()) == pytest.approx(do["what"]["gamma"], abs=0.03)


def test_keys_drive_while_the_dead_man_is_held(page, view):
    page.keyboard.down("KeyW")
    page.wait_for_timeout(150)
    page.keyboard.up("KeyW")
    page.keyboard.down("Shift")
    page.wait_for_timeout(150)
    assert targets(view, "velocity") == []  # neither drives alone
    page.keyboard.up("Shift")
    for key, axis, sign in (("KeyW", 0, 1), ("KeyD", 1, -1), ("KeyR", 2, 1), ("KeyL", 5, -1)):
        view.asked.clear()
        page.keyboard.down("Shift")
        page.keyboard.down(key)
        wait_for(page, view, "velocity", 3)
        page.keyboard.up("Shift")
        wait_for(page, view, "drop")
        page.keyboard.up(key)
        values = targets(view, "velocity")[1][1]["values"]
        assert len(values) == 6
        assert values[axis] * sign > 0.0
        assert np.count_nonzero(np.round(values, 9)) == 1
    no_more(page, view, "act")


def test_tool_axes_turn_what_is_driven(steer):
    """Along the tool's x, for a tool that is turned by 90° about z, is along the world's y."""
    half = np.sqrt(0.5)
    turned = [*STILL[:3], [0.3, 0.0, 0.5, 0.0, 0.0, half, half]]
    frames = partial(frame, poses=turned, targets=[turned[3], None, None])
    with made_up_view(frames=frames) as view:
        page = steer(view)
        page.select_option("#drive-frame", "tool")
        page.fill("#drive-speed", "40")
        page.keyboard.down("Shift")
        page.keyboard.down("KeyW")
        wait_for(page, view, "velocity", 3)
        page.keyboard.up("Shift")
        values = targets(view, "velocity")[0][1]["values"]
        np.testing.assert_allclose(values, [0.0, 0.4 * 0.25, 0.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_a_page_that_loses_the_keys_drives_no_more(page, view):
    page.keyboard.down("Shift")
    page.keyboard.down("KeyW")
    wait_for(page, view, "velocity", 2)
    page.evaluate("dispatchEvent(new Event('blur'))")
    wait_for(page, view, "drop")
    no_more(page, view, "act")


GAMEPAD = """
  window.pad = {
    connected: true, id: "a pad of tests", mapping: "standard", axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })),
  };
  navigator.getGamepads = () => [window.pad];
  dispatchEvent(new Event("gamepadconnected"));
"""


def test_a_gamepad_drives_while_its_button_is_held(page, view):
    page.evaluate(GAMEPAD)
    page.evaluate("pad.axes = [0.05, -1, 0, 0]")  # forward, and a stick that is a little off
    page.wait_for_timeout(200)
    assert targets(view, "velocity") == []
    page.evaluate("pad.buttons[4].value = 1")
    wait_for(page, view, "velocity", 3)
    values = targets(view, "velocity")[0][1]["values"]
    np.testing.assert_allclose(values, [0.25 * 0.25, 0, 0, 0, 0, 0], atol=1e-9)
    page.evaluate("dispatchEvent(new Event('blur'))")
    wait_for(page, view, "drop")
    no_more(page, view, "act")  # held all the while: it must be let go first
    page.evaluate("pad.buttons[4].value = 0")
    page.wait_for_timeout(300)  # it looks some 30 times a second
    page.evaluate("pad.buttons[4].value = 1")
    wait_for(page, view, "velocity", len(targets(view, "velocity")) + 2)
    page.evaluate("pad.buttons[1].value = 1")
    wait_for(page, view, "stop")


def test_the_gamepads_stop_counts_whoever_steers_and_a_refused_stop_is_said(open_page):
    with made_up_view(frames=still) as view:
        view.operator = "other"
        page = open_page(view)
        page.wait_for_selector("#stop:enabled")
        page.evaluate(GAMEPAD)
        page.wait_for_timeout(200)
        assert view.verbs() == []
        view.error = "the robot does not answer"
        page.evaluate("pad.buttons[1].value = 1")
        wait_for(page, view, "stop")
        page.wait_for_selector("#note.refused")
        assert "the robot does not answer" in page.inner_text("#note")
        no_more(page, view, "act")  # held, it asks once
        page.evaluate("pad.buttons[1].value = 0")
        page.wait_for_timeout(200)
        page.evaluate("pad.buttons[1].value = 1")
        wait_for(page, view, "stop", 2)


def test_keys_and_buttons_work_where_a_browser_has_no_gamepads(page, view):
    """As off loopback without TLS."""
    page.evaluate("Object.defineProperty(navigator, 'getGamepads', { value: undefined })")
    page.keyboard.down("Shift")
    page.keyboard.down("KeyW")
    wait_for(page, view, "velocity", 3)
    page.keyboard.up("Shift")
    wait_for(page, view, "drop")


def test_a_controller_without_live_targets_cannot_be_steered(open_page):
    with made_up_view(targets=[], frames=lambda tick: frame(tick, targets=[])) as view:
        page = open_page(view)
        page.wait_for_selector("#stop:enabled")
        assert page.locator("#steer").is_disabled()
        page.wait_for_selector("#note:has-text('no live target')")
        target = {"name": "hand", "frame": "tool", "reference": None}
        view.say({"kind": "changed", "targets": [{**target, "kind": "wrench"}]})
        page.wait_for_selector("#note:has-text('from a program')")
        assert page.locator("#steer").is_disabled()  # a wrench has no handle
        view.say({"kind": "changed", "targets": [{**target, "kind": "frame_pose"}]})
        page.wait_for_selector("#steer:enabled")


LOG = {
    "from_s": 0.0,
    "to_s": 20.0,
    "events": [{"at_s": 3.5, "label": "holder lost", "severity": "error"}],
    "worst": [{"at_s": 12.25, "label": "late by 3 ms"}],
    "overview": {"error": [[t, 0.1 / (1 + t), 0.2 / (1 + t)] for t in range(21)]},
    "second": False,
}


def test_of_a_log_time_is_played_pulled_and_jumped(open_page):
    times = itertools.chain([0.0], itertools.repeat(5.0))
    with made_up_view(
        frames=lambda _: frame(1000, time_s=next(times)), live=False, writes=False, log=LOG
    ) as view:
        page = open_page(view)
        page.click("#play")
        page.select_option("#speed", "5")
        page.click("#play")
        page.select_option("#jump", "12.25")
        page.select_option("#jump", "3.5")
        page.fill("#at", "10")
        page.locator("figure[data-group=error] .u-over").click()
        page.wait_for_timeout(200)
        assert [message["speed"] for message in view.heard("play")] == [1, 5, 0]
        sought = [message["at_s"] for message in view.heard("seek")]
        assert sought[:2] == [12.25, 3.5]
        assert 10 in sought
        assert sought[-1] == pytest.approx(10.0, abs=0.2)  # the middle of the plot
        for each in ("buttons", "holder", "operator"):
            assert page.locator(f"#{each}").is_hidden()


def test_what_is_found_of_a_log_later_is_shown(open_page):
    """The greeting comes first, while the pass through the file goes on."""
    found = {**LOG, "events": [], "worst": [], "overview": {}, "done": False}
    with made_up_view(live=False, writes=False, log=found) as view:
        page = open_page(view)
        error, v = (page.locator(f"figure[data-group={each}]") for each in ("error", "V"))
        assert error.is_visible()
        assert page.locator("#events li").count() == 0
        at_first = page.inner_text("#note")
        first = [{"at_s": 1.0, "label": "granted", "severity": "info"}]
        view.say({"kind": "log", "log": {**found, "events": first}})
        page.wait_for_selector("#events li")
        blank = error.screenshot()
        view.say({"kind": "log", "log": {**LOG, "events": first + LOG["events"], "done": True}})
        page.wait_for_function("() => document.querySelectorAll('#events li').length === 2")
        places = page.locator("#jump option").all_text_contents()
        assert [place for place in places if "late by 3 ms" in place]
        assert [place for place in places if "holder lost" in place]
        assert error.screenshot() != blank  # it has a curve
        assert page.evaluate("hoap3.hello.log.overview.error.length") == 21
        assert v.is_hidden()  # there is none, and there will be none
        assert page.inner_text("#note") != at_first
        page.select_option("#jump", "12.25")
        page.wait_for_timeout(200)
        assert [message["at_s"] for message in view.heard("seek")] == [12.25]


def test_a_page_says_how_many_frames_it_has_drawn(open_page):
    with made_up_view() as view:
        page = open_page(view)
        page.wait_for_function("() => hoap3.drawn.length > 5")
        counts = [each["frames"] for each in view.heard("drawn")]
        assert counts == sorted(set(counts))
        assert counts[-1] >= 5
