"""A browser for all tests of the page, and what opens it on a server that makes its frames up."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from page_bench import TOKEN, MadeUpView
from support.pages.chromium import chromium

SMALL = {"width": 760, "height": 560}  # WebGL is computed here: few pixels are soon drawn
DRAWN = "() => window.hoap3?.drawn.length > 0"


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens pages, each in a profile of its own; any error of theirs fails the test."""
    contexts: list[Any] = []
    errors: list[str] = []

    def opened(view: MadeUpView, token: str = TOKEN, *, wait: str = DRAWN, **options: Any) -> Any:
        context = browser.new_context(**{"viewport": SMALL, **options})
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        page.goto(view.address(token))
        page.wait_for_function(wait)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert [error for error in errors if "WebSocket" not in error] == []


@pytest.fixture
def steer(open_page: Callable[..., Any]) -> Callable[..., Any]:
    """Opens a page that has become the operator."""

    def steering(view: MadeUpView, **options: Any) -> Any:
        page = open_page(view, **options)
        page.click("#steer")
        page.wait_for_selector("#steer[aria-pressed=true]")
        return page

    return steering
