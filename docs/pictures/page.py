"""Makes the pictures of the live page again: `python docs/pictures/page.py`.

It runs HOAP-3 and UR5 in real time and one log, opens their pages in Debian's chromium, and keeps
what that shows.
"""

from __future__ import annotations

import io
import os
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
COLOURS = 200  # of a picture that is kept


def steered(folder: Path) -> Path:
    """The config of HOAP-3 that stands, with a centre of mass that somebody moves."""
    config, _ = read_config("stable_qp_hoap3")
    target = {"kind": "live", "name": "com", "speed_m_s": 0.05}
    target |= {"lower_m": [-0.03, -0.02, 0.2], "upper_m": [0.06, 0.06, 0.32]}
    config["parameters"]["task"]["parameters"]["target"] = target
    path = folder / "steered_com.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    return path


@contextmanager
def command(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A command that runs, and is told to end."""
    words = [*HOAP3, *map(str, arguments)]
    done = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env={**os.environ})
    try:
        yield done
    finally:
        done.terminate()
        done.wait(60)


@contextmanager
def served(*what: object) -> Iterator[str]:
    """The address of a page."""
    with command("view", *what, "--port", 0) as server:
        for line in server.stdout or ():
            if found := ADDRESS.search(line):
                yield found[0]
                return
    raise SystemExit(f"no page: {what}")


def keep(name: str, picture: bytes) -> None:
    """Write a picture with few colours."""
    path = FOLDER / f"{name}.png"
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stderr.write(f"{path} {path.stat().st_size / 1000:.0f} kB\n")


def opened(browser: Any, address: str, size: dict[str, int], scheme: str) -> Any:
    """A page that shows something."""
    page = browser.new_page(viewport=size, color_scheme=scheme)
    page.goto(address)
    page.wait_for_function("() => window.hoap3?.drawn.length > 30", timeout=120_000)
    return page


def part(page: Any, name: str, selector: str) -> None:
    """Keep one part of a page."""
    keep(name, page.locator(selector).screenshot())


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
    page.click("#steer")
    page.wait_for_selector("#steer[aria-pressed=true]")
    page.wait_for_timeout(4000)
    drag(page, "com", 40)
    page.wait_for_timeout(4000)
    keep("live", page.screenshot())
    part(page, "scene", "#view")
    page.mouse.up()
    part(page, "header", "header")
    for name in ("drive", "plots", "change"):
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
    page.fill("#at", "2")
    page.wait_for_timeout(1000)
    keep("log", page.screenshot())
    part(page, "timeline", "#timeline")
    page.close()


def main() -> int:
    """Make them all."""
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = Path(temporary)
        options = {"executable_path": CHROMIUM, "args": ["--no-sandbox", *SOFTWARE_GL]}
        browser = playwright.chromium.launch(**options)
        words = ("--duration", 300, "--set", PATIENT, "--out", folder / "live")
        with command("run", "--controller", steered(folder), *words), served("hoap3") as address:
            live(browser, address)
        for gamma in (0.5, 0.3):
            words = ("--set", f"controller.parameters.gamma={gamma}", "--out", folder / str(gamma))
            subprocess.run([*HOAP3, "run", "--lockstep", *map(str, words)], check=True)
        with served(folder / "0.5", folder / "0.3") as address:
            log(browser, address)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
