"""What the page draws is what it was sent, and it is readable."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from page_bench import LINKS, PLOTS, TOKEN, code, frame, made_up_view

pytestmark = pytest.mark.slow
PLACES = "Object.fromEntries(Object.entries(hoap3.{}))"


def matrix(pose: Any) -> Any:
    """Of a pose, (4, 4)."""
    x, y, z, w = np.array(pose[3:]) / np.linalg.norm(pose[3:])
    found = np.eye(4)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    found[:3, 3] = pose[:3]
    return found


def drawn(page: Any, which: str = "poses") -> dict[str, Any]:
    """World matrices of the links of the picture that is shown, (4, 4)."""
    found = page.evaluate(PLACES.format(which))
    return {name: np.reshape(columns, (4, 4)).T for name, columns in found.items()}


def show(page: Any, view: Any, tick: int, **more: Any) -> None:
    """Send a page a frame, and wait until it is drawn."""
    view.say(frame(tick, **more))
    page.wait_for_function("tick => hoap3.tick === tick", arg=tick)


def random_poses(random: Any) -> list[list[float]]:
    turned = random.normal(size=(len(LINKS), 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return np.hstack([random.uniform(-1, 1, (len(LINKS), 3)), turned]).tolist()


def test_links_are_where_the_frame_has_them(open_page):
    random = np.random.default_rng(1)
    with made_up_view(frames=None) as view:
        page = open_page(view, wait="() => window.hoap3?.hello")
        for tick in range(1, 21):
            where = random_poses(random)
            show(page, view, tick, poses=where)
            seen = drawn(page)
            for link, pose in zip(LINKS, where, strict=True):
                np.testing.assert_allclose(seen[link["name"]], matrix(pose), atol=1e-6)


def test_a_second_log_is_drawn_as_a_ghost(open_page):
    random = np.random.default_rng(2)
    log = {"from_s": 0.0, "to_s": 1.0, "events": [], "worst": [], "overview": {}, "second": True}
    with made_up_view(frames=None, live=False, log=log) as view:
        page = open_page(view, wait="() => window.hoap3?.hello")
        where, other = random_poses(random), random_poses(random)
        show(page, view, 7, poses=where, ghost=other)
        seen, ghost = drawn(page), drawn(page, "ghost")
        for link, pose, shade in zip(LINKS, where, other, strict=True):
            np.testing.assert_allclose(seen[link["name"]], matrix(pose), atol=1e-6)
            np.testing.assert_allclose(ghost[link["name"]], matrix(shade), atol=1e-6)


def test_the_picture_has_the_robot_in_it(open_page):
    """Of two pictures that differ in the robot's place alone, pixels differ."""
    with made_up_view(frames=None) as view:
        page = open_page(view, wait="() => window.hoap3?.hello")
        pictures = []
        for tick in (1, 2):
            moved = np.array(frame(100)["poses"]) + np.array([0.1 * tick, 0, 0, 0, 0, 0, 0])
            show(page, view, tick, poses=moved.tolist())
            pictures.append(page.locator("#stage canvas").screenshot())
        assert pictures[0] != pictures[1]


def test_state_is_told_in_words(open_page):
    said = {"mode": "stopped", "stop_reason": "misses", "q": [0.5, 1.8, 7.0]}
    with made_up_view(frames=lambda tick: frame(tick, **said)) as view:
        page = open_page(view)
        page.wait_for_selector("#mode[data-mode=stopped]")
        assert "misses" in page.inner_text("#mode")
        assert "qp12-4711" in page.inner_text("#holder")
        assert "pass" in page.inner_text("[data-of=deadlines]")
        assert "fail" in page.inner_text("[data-of=task]")
        assert "not judged" in page.inner_text("[data-of=limits_and_balance]")
        assert page.locator("#joints li.near").count() == 1  # `lift`, at its upper limit
        assert "gamma" in page.locator("#config").text_content()
        figures = page.locator("figure[data-group]")
        assert figures.count() == 4
        assert "–" not in page.inner_text("figure[data-group=error] output")
        view.say({"kind": "event", "at_s": 1.5, "label": "<b>held</b>", "severity": "warning"})
        page.wait_for_selector("#events li")
        assert "<b>held</b>" in page.inner_text("#events li")  # text, whatever it holds


def test_the_legend_lists_what_the_robot_has(open_page):
    bare = {"com": None, "zmp": None, "polygon": [], "contacts": [], "targets": []}
    bare["frames"] = []
    with made_up_view(frames=lambda tick: frame(tick, **bare), targets=[], soles=[]) as view:
        page = open_page(view)
        page.wait_for_selector("#tick:not(:has-text('…'))")
        assert page.locator("#key [data-of]:visible").count() == 0
    with made_up_view() as view:
        page = open_page(view)
        page.wait_for_selector("#key [data-of=zmp]:visible")
        assert page.locator("#key [data-of]:visible").count() == 6
        assert page.is_visible("#turned-key")  # a target has axes of its own
        assert page.is_hidden("#handles-key")  # without an operator


def test_plots_of_the_certificate_are_folded(open_page):
    plots = [{**each, "certificate": each["group"] != "error"} for each in PLOTS]
    with made_up_view(plots=plots) as view:
        page = open_page(view)
        shown = page.locator("figure[data-group]:visible")
        assert shown.evaluate_all("all => all.map(each => each.dataset.group)") == ["error"]
        page.click("#certificate summary")
        page.wait_for_selector("figure[data-group=margin] canvas:visible")


def test_an_old_picture_says_so_and_a_new_one_takes_that_back(open_page):
    with made_up_view() as view:
        page = open_page(view)
        assert page.locator("#banner").is_hidden()
        view.flowing = False
        page.wait_for_selector("#banner:not([hidden])")
        assert " s old" in page.inner_text("#banner")
        view.flowing = True
        page.wait_for_selector("#banner", state="hidden")
        view.cut()
        page.wait_for_selector("#banner:not([hidden])")
        page.wait_for_selector("#banner", state="hidden")  # it has connected again
        page.wait_for_function("() => hoap3.proved")


@pytest.mark.parametrize("least", [1e-20, 1e-29, 1e-45, 5e-324])
def test_a_robot_that_rests_holds_up_no_page(open_page, least):
    """Of a robot at rest V becomes as small as a number can, and others differ in the last bit."""

    def resting(tick):
        v = max(0.5 ** (tick / 4), least)
        near_one = 1.0 - (tick % 32) * 1e-16 / 16
        values = {"v": v, "error": math.sqrt(2.0 * v), "is": -v, "must": v, "margin": near_one}
        return frame(tick, values=values)

    with made_up_view(frames=resting) as view:
        page = open_page(view)
        page.wait_for_function("() => hoap3.drawn.length > 60")
        page.wait_for_function(
            "least => Number(document.querySelector('figure[data-group=V] output').textContent)"
            " < 2 * least + 1e-320",
            arg=least,
        )


def test_a_robot_that_says_nothing_to_a_page_that_has_just_come_is_called_silent(open_page):
    with made_up_view(frames=None) as view:
        page = open_page(view, wait="() => window.hoap3?.hello")
        page.wait_for_selector("#banner:not([hidden])")
        view.say(frame(16))
        page.wait_for_selector("#banner", state="hidden")


def test_a_robot_of_20_hz_is_not_called_silent(open_page):
    """One of 16 States is shown: one each 0.8 s."""
    with made_up_view(frames=None, period_s=0.05) as view:
        page = open_page(view, wait="() => window.hoap3?.hello")
        show(page, view, 16)
        page.wait_for_timeout(1000)
        assert page.locator("#banner").is_hidden()
        page.wait_for_selector("#banner:not([hidden])", timeout=20_000)


def test_hmac_is_that_of_python(open_page):
    random = np.random.default_rng(3)
    texts = [random.bytes(int(n)).hex() for n in random.integers(0, 200, 150)]
    texts += ["", "ä€😀", "\n", "a" * 55, "a" * 56, "a" * 63, "a" * 64, "a" * 65, "\u0000"]
    with made_up_view() as view:
        page = open_page(view)
        pairs = [(TOKEN, text) for text in texts] + [(text, "x") for text in texts]
        found = page.evaluate(
            """async (pairs) => {
                 const { hmac } = await import("/hmac.js");
                 return pairs.map(([key, text]) => hmac(key, text));
               }""",
            pairs,
        )
    assert found == [code(text, key) for key, text in pairs]


def test_nothing_is_asked_of_anybody_else(open_page, browser):
    with made_up_view() as view:
        context = browser.new_context(viewport={"width": 760, "height": 560})
        page = context.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda socket: asked.append(socket.url.replace("ws:", "http:")))
        page.goto(view.address())
        page.wait_for_function("() => window.hoap3?.drawn.length > 3")
        context.close()
        assert {f"{view.origin}/mesh/tetrahedron", f"{view.origin}/socket"} <= set(asked)
        assert all(url.startswith((view.origin, f"blob:{view.origin}")) for url in asked)


def test_a_frame_holds_what_json_has(open_page):
    """What is not known is null, and the page lives with it."""
    nothing = {"com": None, "zmp": None, "polygon": None, "contacts": [], "frames": []}
    nothing |= {"targets": [None] * 3, "values": {}, "verdicts": {}, "holder": None}
    with made_up_view(frames=lambda tick: json.loads(json.dumps(frame(tick, **nothing)))) as view:
        page = open_page(view)
        page.wait_for_function("() => hoap3.drawn.length > 2")
        assert page.inner_text("#holder") == "none"


SIZES = [{"width": 390, "height": 844}, {"width": 1280, "height": 800}]

CONTRAST = """() => {
  const channels = (color) => color.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b]
    .map((c) => c / 255).map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const found = channels(getComputedStyle(at).backgroundColor);
      if (found.length === 3 || found[3] === 1) return found;
    }
  };
  const poor = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    const style = getComputedStyle(element);
    const mark = element.closest(".mark, script, option, button:disabled");
    if (!walk.currentNode.data.trim() || mark || !element.checkVisibility()) continue;
    const [a, b] = [light(channels(style.color)), light(behind(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(style.fontSize);
    const bold = style.fontWeight >= 700;
    const enough = size >= 24 || (bold && size >= 18.6) ? 3 : 4.5;
    if (ratio < enough || size < 10.5) poor.push([walk.currentNode.data.trim(), ratio, size]);
  }
  return poor;
}"""

OVERLAPS = """() => {
  const found = [];
  const groups = "header > *, #left > *, #side > *, .card > *, #buttons > *";
  const boxes = [...document.querySelectorAll(groups)]
    .filter((each) => each.checkVisibility() && getComputedStyle(each).position !== "fixed");
  for (const one of boxes) for (const other of boxes) {
    if (one === other || one.parentElement !== other.parentElement) continue;
    const [a, b] = [one.getBoundingClientRect(), other.getBoundingClientRect()];
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 1 && down > 1) found.push([one.id || one.className, other.id || other.className]);
  }
  return found;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES, ids=lambda size: str(size["width"]))
def test_the_page_is_readable(open_page, size, scheme):
    with made_up_view() as view:
        page = open_page(view, viewport=size, color_scheme=scheme)
        page.wait_for_function("() => hoap3.proved && hoap3.drawn.length > 4")
        wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.evaluate(wide) <= 0
        assert page.evaluate(CONTRAST) == []
        assert page.evaluate(OVERLAPS) == []
        stop, *others = (
            page.locator(f"#{name}").bounding_box() for name in ("stop", "recover", "steer")
        )
        for other in others:
            assert stop["width"] * stop["height"] > 1.3 * other["width"] * other["height"]
        assert stop["y"] + stop["height"] <= size["height"]  # in sight without scrolling


def test_colours_follow_the_scheme_at_once(open_page):
    background = "() => getComputedStyle(document.body).backgroundColor"
    with made_up_view() as view:
        page = open_page(view, color_scheme="light")
        before = page.evaluate(background)
        page.emulate_media(color_scheme="dark")
        assert page.evaluate(background) != before


def test_what_comes_moves_nothing_that_is_read(open_page):
    shifts = """() => new Promise((done) => {
      let sum = 0;
      new PerformanceObserver((list) => list.getEntries().forEach((each) => (sum += each.value)))
        .observe({ type: "layout-shift" });
      setTimeout(() => done(sum), 1500);
    })"""
    with made_up_view() as view:
        page = open_page(view)
        page.wait_for_function("() => hoap3.proved && hoap3.drawn.length > 4")
        assert page.evaluate(shifts) < 0.01


def test_whatever_can_be_pressed_has_a_name_and_is_reached_by_keys(steer):
    nameless = """() => [...document.querySelectorAll("button, input, select, summary")]
      .filter((each) => each.checkVisibility())
      .filter((each) => ![each.ariaLabel, each.labels?.[0]?.innerText, each.innerText]
        .some((name) => name?.trim()))
      .map((each) => each.outerHTML)"""
    with made_up_view() as view:
        page = steer(view)
        assert page.evaluate(nameless) == []
        reached = set()
        page.evaluate("document.activeElement.blur()")
        for _ in range(60):
            page.keyboard.press("Tab")
            focused = "document.activeElement.id || document.activeElement.tagName"
            reached.add(page.evaluate(focused))
        drives = {"drive-target", "drive-frame", "drive-speed"}
        assert {"steer", "stop", "SUMMARY"} | drives <= reached
