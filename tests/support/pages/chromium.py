"""Debian's chromium, driven without a screen; WebGL is computed by the processor."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def chromium(*options: str) -> Iterator[Any]:
    """A browser; where there is none the test fails, for the page would be untested."""
    path = shutil.which("chromium")
    if path is None:
        pytest.fail("tests of the page drive Debian's chromium: apt-get install -y chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", *SOFTWARE_GL, *options]
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        try:
            yield browser
        finally:
            browser.close()
