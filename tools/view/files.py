"""What the server gives to browsers: a fixed list of files, nothing by path, nothing from outside.

The headers forbid a page to load, run or ask anything that does not come from this server.
"""

from __future__ import annotations

import re
from importlib import resources
from pathlib import PurePath

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Content types of the files in `static/`, by suffix; others are not served."""

MESH = re.compile(r"/mesh/([0-9a-f]{64})")


def policy(host: str) -> str:
    """The Content-Security-Policy of all that is given, for a page reached as `host`."""
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "img-src 'self' data: blob:",
            f"connect-src 'self' ws://{host}",
            "worker-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        )
    )


def headers(host: str, kind: str, size: int) -> dict[str, str]:
    """Headers of an answer."""
    return {
        "Content-Type": kind,
        "Content-Length": str(size),
        "Content-Security-Policy": policy(host),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cache-Control": "no-store",
        "Connection": "close",
    }


def read_static() -> dict[str, tuple[bytes, str]]:
    """Content and type of all files of the page, by path."""
    found = {}
    for file in (resources.files("hoap3.tools.view") / "static").iterdir():
        kind = TYPES.get(PurePath(file.name).suffix)
        if kind is not None:
            path = "/" if file.name == "index.html" else f"/{file.name}"
            found[path] = file.read_bytes(), kind
    return found
