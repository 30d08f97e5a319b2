"""Makes the live page's pictures: `python docs/pictures/page.py`.

It runs HOAP-3 in real time, opens its page in Debian's chromium as the operator, and keeps
screenshots of a wide page and of a phone.
"""

from __future__ import annotations

import io
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from PIL import Image
from playwright.sync_api import sync_playwright

from hoap3.remote_controller.config import read_config

FOLDER = Path(__file__).parent / "view"
CHROMIUM = "/usr/bin/chromium"
SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WIDE, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
HOAP3 = [sys.executable, "-m", "hoap3.tools.cli.app"]
PATIENT = "emulator.misses_to_stop=100000"  # a browser that draws without a GPU takes both CPUs
ADDRESS = re.compile(r"http://\S+")
TRIES = 5
MOVED_M = 0.003  # by which a target that is pulled has moved before a picture is kept


class LostError(Exception):
    """The page does not steer where a picture should show that it does."""


def steered(folder: Path) -> Path:
    """The config of HOAP-3 that stands, with a centre of mass that somebody moves."""
    config, _ = read_config("stable_qp_hoap3")
    target = {"kind": "live", "name": "com", "speed_m_s": 0.05}
    target |= {"lower_m": [-0.03, -0.02, 0.2], "upper_m": [0.06, 0.06, 0.32]}
    config["parameters"]["task"]["parameters"]["target"] = target
    path = folder / "steered_com.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    return path


def wait_for_robot(folder: Path, name: str = "hoap3") -> None:
    """Until it follows its controller, which may compile first."""
    for _ in range(400):
        words = [*HOAP3, "status", name, "--json"]
        told = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        if '"active"' in told.stdout:
            return
    raise SystemExit("the robot does not begin")


@contextmanager
def command(folder: Path, *arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A command that runs in a folder, and is told to end."""
    words = [*HOAP3, *map(str, arguments)]
    done = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=folder)
    try:
        yield done
    finally:
        done.terminate()
        done.wait(60)


@contextmanager
def served(folder: Path, *what: object) -> Iterator[str]:
    """The address of a page."""
    with command(folder, "view", *what, "--port", 0) as server:
        for line in server.stdout or ():
            if found := ADDRESS.search(line):
                yield found[0]
                return
    raise SystemExit(f"no page: {what}")


def keep(name: str, picture: bytes) -> None:
    """Write a picture, as small as it gets without a loss."""
    path = FOLDER / f"{name}.png"
    Image.open(io.BytesIO(picture)).convert("RGB").save(path, optimize=True)
    sys.stderr.write(f"{path} {path.stat().st_size / 1000:.0f} kB\n")


def opened(browser: Any, address: str, size: dict[str, int], scheme: str) -> Any:
    """A page that shows something."""
    page = browser.new_page(viewport=size, color_scheme=scheme)
    page.set_default_timeout(120_000)
    page.goto(address)
    page.wait_for_function("() => window.hoap3?.drawn.length > 0")
    return page


def shot(page: Any, selector: str) -> bytes:
    """One part of a page; of `body` what is seen of it.

    Raises:
        LostError: the page warns that its frames are old.
    """
    page.wait_for_selector("#banner", state="hidden")
    clip = None if selector == "body" else page.locator(selector).bounding_box()
    picture: bytes = page.screenshot(clip=clip)
    if page.is_visible("#banner"):
        raise LostError
    return picture


def steer(page: Any) -> None:
    """Become the operator, or again: on a busy machine a page falls silent for a moment."""
    if page.get_attribute("#steer", "aria-pressed") == "false":
        page.click("#steer")
    page.wait_for_selector("#steer[aria-pressed=true]")
    page.wait_for_timeout(300)


def drag(page: Any, target: str, pixels: float) -> None:
    """Pull a target along x, and hold it, until it has moved.

    Raises:
        LostError: the page steers no longer, or nothing moves.
    """
    before = place(page)
    found = page.evaluate("name => hoap3.gizmo(name)", target)
    (x0, y0), (x, y) = found["centre"], found["handle"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + pixels * (x - x0) / 40, y + pixels * (y - y0) / 40, steps=15)
    for _ in range(40):
        page.wait_for_timeout(100)
        if math.dist(place(page), before) > MOVED_M:
            break
    else:
        raise LostError(f"{target} is pulled, and does not move")
    insist(page)


def place(page: Any) -> list[float]:
    """Where the newest frame has the first target."""
    page.wait_for_function("() => hoap3.frame?.targets[0]")  # none after a greeting that is new
    found: list[float] = page.evaluate("hoap3.frame.targets[0]")
    return found[:3]


def insist(page: Any) -> None:
    """That this page steers, and drags, at the moment of a picture."""
    steers = page.get_attribute("#steer", "aria-pressed") == "true"
    if not steers or page.evaluate("hoap3.acting") != "drag":
        raise LostError("the page steers no longer: " + page.inner_text("#note"))


def pull(page: Any) -> None:
    """Pull the centre of mass there, back and there again, so that plots have something to show."""
    for pixels in (40, -40, 40):
        page.mouse.up()
        steer(page)
        drag(page, "com", pixels)
        page.wait_for_timeout(1500)
    insist(page)


def keep_while_pulled(page: Any, parts: dict[str, str]) -> None:
    """Keep parts of a page that steers and pulls, also when the last of them is taken.

    Raises:
        LostError: on a busy machine it fell silent each time, and was let go.
    """
    for left in reversed(range(TRIES)):
        try:
            pull(page)
            shots = {name: shot(page, selector) for name, selector in parts.items()}
            insist(page)
        except LostError:
            if not left:
                raise
        else:
            break
    page.mouse.up()
    for name, picture in shots.items():
        keep(name, picture)


def live(browser: Any, address: str) -> None:
    """HOAP-3, whose centre of mass is pulled."""
    page = opened(browser, address, WIDE, "light")
    keep_while_pulled(page, {"live": "body", "drive": "#drive"})
    page.close()
    page = opened(browser, address, PHONE, "dark")
    page.wait_for_timeout(4000)
    keep("phone", page.screenshot())
    page.close()


def make_live(browser: Any, folder: Path) -> None:
    """Of a robot that runs."""
    words = ("--duration", 600, "--set", PATIENT, "--out", folder / "live")
    with command(folder, "run", "--controller", steered(folder), *words):
        wait_for_robot(folder)
        with served(folder, "hoap3") as address:
            live(browser, address)


def main() -> int:
    """Make all of them."""
    FOLDER.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        options = {"executable_path": CHROMIUM, "args": ["--no-sandbox", *SOFTWARE_GL]}
        browser = playwright.chromium.launch(**options)
        with tempfile.TemporaryDirectory() as folder:
            make_live(browser, Path(folder))
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
