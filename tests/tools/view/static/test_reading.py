"""Readable: on a phone and on a wide screen, in the light and in the dark, by mouse and by keys."""

from __future__ import annotations

import pytest
from page_bench import made_up_view

pytestmark = pytest.mark.slow
SIZES = [{"width": 390, "height": 844}, {"width": 1280, "height": 800}]
SCHEMES = ["light", "dark"]

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


@pytest.mark.parametrize("scheme", SCHEMES)
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
        for _ in range(40):
            page.keyboard.press("Tab")
            reached.add(
                page.evaluate("document.activeElement.id || document.activeElement.tagName")
            )
        wanted = {
            "steer",
            "recover",
            "stop",
            "drive-target",
            "drive-frame",
            "drive-speed",
            "SUMMARY",
        }
        assert wanted <= reached
