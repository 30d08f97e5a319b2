"""Operates the live page with the keyboard alone, or by touch alone."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

WIDE = {"viewport": {"width": 1280, "height": 800}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
LEAST_PX = 40  # width and height of what a finger presses
TRIES = 80  # presses of a key, or swipes, until something is reached
KEYS = {"+x": "KeyW", "Rotate ↺ z": "KeyJ"}  # of buttons that drive

SHOWN = """async (each) => {
  let box, before;
  do { // until scrolling has ended
    before = each.getBoundingClientRect().top;
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    box = each.getBoundingClientRect();
  } while (box.top !== before);
  const across = box.left >= 0 && box.right <= innerWidth;
  const inside = across && box.top >= 0 && box.bottom <= innerHeight;
  const middle = [(box.left + box.right) / 2, (box.top + box.bottom) / 2];
  return inside && each.contains(document.elementFromPoint(...middle));
}"""
"""Whether all of an element is in the window, and its middle not behind something else."""

CUT = """each => [each, ...each.querySelectorAll("*")]
  .filter((one) => getComputedStyle(one).textOverflow === "ellipsis")
  .filter((one) => one.scrollWidth > one.clientWidth)
  .map((one) => one.textContent)"""
"""Texts of which only a part is shown."""


class Hand:
    """Operates a page in one way."""

    def __init__(self, page, view):
        self.page, self.view = page, view

    def button(self, name):
        return self.page.get_by_role("button", name=name, exact=True)

    def wait_for(self, verb, count=1):
        """What the server has received with a verb, once there is as much of it."""
        for _ in range(400):
            found = [do for _, do in self.view.asked if do["verb"] == verb]
            if len(found) >= count:
                return found
            self.page.wait_for_timeout(25)
        pytest.fail(f"the page has not sent {verb}: {self.view.verbs()}")

    def see(self, element):
        """Scroll until it is shown, and nothing of its text is cut off."""
        for _ in range(TRIES):
            if element.evaluate(SHOWN):
                assert element.evaluate(CUT) == []
                return
            self.scroll(down=element.bounding_box()["y"] > 100)
        pytest.fail(f"not shown: {element}")


class Keyboard(Hand):
    """Tab, arrows, Enter and shortcuts."""

    options = WIDE

    def scroll(self, down):
        self.page.keyboard.press("ArrowDown" if down else "ArrowUp")

    def reach(self, control):
        for _ in range(TRIES):
            if control.evaluate("each => each === document.activeElement"):
                assert control.evaluate(SHOWN)
                return
            self.page.keyboard.press("Tab")
        pytest.fail(f"Tab does not reach {control}")

    def press(self, control):
        self.reach(control)
        self.page.keyboard.press("Enter")

    def enter(self, field, value):
        self.reach(field)
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(str(value))

    def raise_slider(self, slider):
        self.reach(slider)
        self.page.keyboard.press("ArrowRight")

    def stop(self):
        self.page.keyboard.press("Escape")

    @contextmanager
    def driving(self, button):
        for key in ("Shift", KEYS[button]):
            self.page.keyboard.down(key)
        yield
        for key in ("Shift", KEYS[button]):
            self.page.keyboard.up(key)

    def drag_aside(self):
        """Drive the target along x instead; its name and velocity."""
        choice = self.page.get_by_role("combobox", name="Target", exact=True)
        self.reach(choice)
        self.page.keyboard.press("ArrowDown")
        with self.driving("+x"):
            do = self.wait_for("velocity", 3)[-1]
        return do["name"], do["values"]


class Touch(Hand):
    """One finger or two on a phone, and its keyboard on the screen."""

    options = PHONE

    def __init__(self, page, view):
        super().__init__(page, view)
        self.devtools = page.context.new_cdp_session(page)

    def fingers(self, kind, *places):
        """Dispatch touchStart, touchMove or touchEnd with all fingers that are down."""
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
        self.devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def move_finger(self, start, end):
        """Put a finger down, and move it; it stays down."""
        self.fingers("touchStart", start)
        for place in np.linspace(start, end, 11)[1:].tolist():
            self.fingers("touchMove", place)

    def scroll(self, down):
        self.move_finger((3, 640), (3, 340 if down else 760))  # below the picture, which turns
        self.fingers("touchEnd")

    def place(self, control, share=0.5):
        """Where a finger presses a control."""
        self.see(control)
        box = control.bounding_box()
        assert min(box["width"], box["height"]) >= LEAST_PX
        return box["x"] + share * box["width"], box["y"] + box["height"] / 2

    def press(self, control):
        self.page.touchscreen.tap(*self.place(control))

    def enter(self, field, value):
        self.press(field)
        field.select_text()
        self.page.keyboard.insert_text(str(value))

    def raise_slider(self, slider):
        self.move_finger(self.place(slider, 0.7), self.place(slider, 0.9))
        self.fingers("touchEnd")

    def stop(self):
        """While the page still scrolls: a browser makes no click of a tap that ends it."""
        self.scroll(down=True)
        assert self.button("Stop").evaluate(SHOWN)
        self.press(self.button("Stop"))

    @contextmanager
    def driving(self, button):
        hold, way = self.place(self.button("Hold to drive")), self.place(self.button(button))
        assert self.button("Hold to drive").evaluate(SHOWN)  # both at once
        self.fingers("touchStart", self.place(self.button("Hold to drive")))
        self.fingers("touchStart", hold, way)
        yield
        self.fingers("touchEnd")

    def drag_aside(self):
        """Drag the target's handle along x; its name, and by how far."""
        self.see(self.page.locator("#stage canvas"))
        start, found = self.page.evaluate("[hoap3.frame.targets[1], hoap3.gizmo('aside')]")
        centre, handle = np.array(found["centre"]), np.array(found["handle"])
        self.move_finger(handle, 3 * handle - 2 * centre)
        do = self.wait_for("target")[-1]
        self.fingers("touchEnd")
        return do["name"], np.subtract(do["values"], start).tolist()
