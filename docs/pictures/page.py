"""Makes the pictures of the live page again: `python docs/pictures/page.py [live] [log]`.

It runs HOAP-3 in real time, and two logs, opens their pages in Debian's chromium, and keeps
what that shows.
"""

from __future__ import annotations

import io
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
TALL = {"width": 1280, "height": 2400}  # whatever is beside the picture at once
HOAP3 = [sys.executable, "-m", "hoap3.tools.cli.app"]
PATIENT = "emulator.misses_to_stop=100000"  # a browser that draws without a GPU takes both CPUs
ADDRESS = re.compile(r"http://\S+")


def steered(folder: Path) -> Path:
    """The config of HOAP-3 that stands, with a centre of mass that somebody moves."""
    config, _ = read_config("stable_qp_hoap3")
    target = {"kind": "live", "name": "com", "speed_m_s": 0.05}
    target |= {"lower_m": [-0.03, -0.02, 0.2], "upper_m": [0.06, 0.06, 0.32]}
    config["parameters"]["task"]["parameters"]["target"] = target
    path = folder / "steered_com.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    return path


def wait_for_robot(folder: Path) -> None:
    """Until it follows its controller, which may compile first."""
    for _ in range(400):
        words = [*HOAP3, "status", "hoap3", "--json"]
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


def part(page: Any, name: str, selector: str) -> None:
    """Keep one part of a page."""
    keep(name, page.screenshot(clip=page.locator(selector).bounding_box()))


def steer(page: Any) -> None:
    """Become the operator, or again: on a busy machine a page falls silent for a moment."""
    if page.get_attribute("#steer", "aria-pressed") == "false":
        page.click("#steer")
    page.wait_for_selector("#steer[aria-pressed=true]")
    page.wait_for_timeout(300)


def drag(page: Any, target: str, pixels: float) -> None:
    """Pull a target along x, and hold it."""
    found = page.evaluate("name => hoap3.gizmo(name)", target)
    (x0, y0), (x, y) = found["centre"], found["handle"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + pixels * (x - x0) / 40, y + pixels * (y - y0) / 40, steps=15)


def live(browser: Any, address: str) -> None:
    """HOAP-3, whose centre of mass is pulled."""
    page = opened(browser, address, WIDE, "light")
    for pixels in (40, -40):  # so that plots have something to show
        steer(page)
        drag(page, "com", pixels)
        page.wait_for_timeout(1500)
        page.mouse.up()
    steer(page)
    drag(page, "com", 40)
    keep("live", page.screenshot())
    part(page, "scene", "#view")
    page.mouse.up()
    part(page, "header", "header")
    part(page, "drive", "#drive")
    page.evaluate("document.querySelector('#view').style.maxHeight = '20rem'")  # soon drawn
    page.set_viewport_size(TALL)
    page.wait_for_timeout(1000)
    for name in ("plots", "change"):
        part(page, name, f"#{name}")
    for name in ("verdicts", "joints"):
        part(page, name, f"section:has(> #{name})")
    page.close()
    page = opened(browser, address, PHONE, "dark")
    page.wait_for_timeout(4000)
    keep("phone", page.screenshot())
    page.close()


def log(browser: Any, address: str) -> None:
    """A log, some way through."""
    page = opened(browser, address, WIDE, "dark")
    page.fill("#at", "1.2")
    page.wait_for_timeout(3000)
    keep("log", page.screenshot())
    part(page, "timeline", "#timeline")
    page.close()


def make_live(browser: Any, folder: Path) -> None:
    """Of a robot that runs."""
    words = ("--duration", 600, "--set", PATIENT, "--out", folder / "live")
    with command(folder, "run", "--controller", steered(folder), *words):
        wait_for_robot(folder)
        with served(folder, "hoap3") as address:
            live(browser, address)


def make_log(browser: Any, folder: Path) -> None:
    """Of two logs."""
    for gamma in (0.5, 0.3):
        words = [
            f"controller.parameters.gamma={gamma}",
            "--duration",
            3,
            "--out",
            folder / f"{gamma}",
        ]
        run = [*HOAP3, "run", "--lockstep", "--set", *map(str, words)]
        subprocess.run(run, check=False)  # 1 where 3 s are too short to come there
    with served(folder, folder / "0.5", folder / "0.3") as address:
        log(browser, address)


MAKE = {"live": make_live, "log": make_log}


def main() -> int:
    """Make those that are named, or all."""
    FOLDER.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        options = {"executable_path": CHROMIUM, "args": ["--no-sandbox", *SOFTWARE_GL]}
        browser = playwright.chromium.launch(**options)
        for name in sys.argv[1:] or MAKE:
            with tempfile.TemporaryDirectory() as folder:
                MAKE[name](browser, Path(folder))
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
