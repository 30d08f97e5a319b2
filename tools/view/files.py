"""What the server gives to browsers: a fixed list of files, nothing by path, nothing from outside.

The headers forbid a page to load, run or ask anything that does not come from this server.
"""

from __future__ import annotations

import re
from importlib import resources

SCRIPT, STYLE = "text/javascript; charset=utf-8", "text/css; charset=utf-8"
STATIC = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", STYLE),
    "/vendor.css": ("vendor.css", STYLE),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
    **{
        f"/{name}.js": (f"{name}.js", SCRIPT)
        for name in (
            *("page", "scene", "panels", "plots", "teleop"),
            *("connection", "hmac", "beat", "vendor", "posture"),
            *("colours", "overlays", "robot", "targets", "timeline"),
        )
    },
}
"""Files of `static/` and their types, by where they are found."""

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
    """Content and type of all files that are there."""
    folder = resources.files("hoap3.tools.view") / "static"
    found = {}
    for path, (name, kind) in STATIC.items():
        file = folder / name
        if file.is_file():
            found[path] = file.read_bytes(), kind
    return found
