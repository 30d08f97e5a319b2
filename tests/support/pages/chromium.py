"""Debian's chromium, driven without a screen; WebGL is computed by the processor."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

LOCK = Path(tempfile.gettempdir()) / f"hoap3_chromium_{os.getuid()}"
TRIES = 20
SETTLED = """key => [...document.querySelectorAll('#sliders small.told')].some(each =>
    each.textContent.startsWith(key + ':') && !each.textContent.endsWith('…'))"""
"""Whether the controller has answered to a change of a number."""


@contextmanager
def chromium(*options: str) -> Iterator[Any]:
    """A browser, one at a time; where there is none the test fails: the page would be untested.

    Its pictures are computed by the CPUs, and several browsers at once leave none for the robots of
    other tests.
    """
    path = shutil.which("chromium")
    if path is None:
        pytest.fail("tests of the page drive Debian's chromium: apt-get install -y chromium")
    from playwright.sync_api import sync_playwright

    with open(LOCK, "w") as lock, sync_playwright() as playwright:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of all processes of all runs here
        arguments = ["--no-sandbox", *SOFTWARE_GL, *options]
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        try:
            yield browser
        finally:
            browser.close()


def change_number(page: Any, key: str, value: str) -> None:
    """Set a number of the controller, again where a slow browser asks for it too late."""
    told = page.locator("small.told", has_text=re.compile(rf"^{re.escape(key)}(:|$)"))
    field = page.locator("#sliders .setting").filter(has=told).locator("input")
    for _ in range(TRIES):
        field.fill(value)
        field.dispatch_event("change")
        page.wait_for_function(SETTLED, arg=key)
        if told.inner_text().endswith("changed"):
            return
    pytest.fail(f"{key} is not changed: {told.inner_text()}")
