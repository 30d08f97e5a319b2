"""Takes the pictures of a report: `python docs/pictures/readme/shoot.py`.

It needs a browser, and `pip install playwright`, which nothing else here does. A Chromium that is
installed is named by the environment variable CHROMIUM.
"""

from __future__ import annotations

import os
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from hoap3.tools.analysis.report.page import write_report
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_realtime

FOLDER = Path(__file__).resolve().parent
WIDTH, END = 1180, "#figure-views"  # px; a picture ends below that figure
QUALITY = 88
SECONDS = 5.0


def main() -> int:
    """Run HOAP-3 in real time, and look at the report."""
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        os.chdir(scratch)  # a report says where its log is
        folder = Path("hoap3_qp12")
        sides = load_emulator_config("hoap3", seed=0)[0], load_controller_config("qp12")[0]
        run_realtime(*sides, SECONDS, folder, lambda _: None)
        page_file = Path(write_report(folder)["report"]).resolve()
        browser = driver.chromium.launch(
            executable_path=os.environ.get("CHROMIUM"), args=["--no-sandbox"]
        )
        for scheme, name in (("light", "report.webp"), ("dark", "report_dark.webp")):
            page = browser.new_page(viewport={"width": WIDTH, "height": 1200}, color_scheme=scheme)
            page.goto(f"file://{page_file}")
            box = page.locator(END).bounding_box()
            clip = {"x": 0, "y": 0, "width": WIDTH, "height": box["y"] + box["height"] + 16}
            shot = Image.open(BytesIO(page.screenshot(clip=clip, full_page=True)))
            shot.convert("RGB").save(FOLDER / name, quality=QUALITY, method=6)
            sys.stderr.write(f"{FOLDER / name}\n")
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
