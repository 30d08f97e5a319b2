"""What every page of ours is made of: one HTML file that loads nothing and runs nothing.

The content security policy at its head forbids both, so that even a mistake of ours could not let a
log do what only its reader may. Templates escape whatever they are given.
"""

from __future__ import annotations

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from hoap3.tools.analysis.numbers import count, number, rate, seconds
from hoap3.tools.picture.palette import COLOURS

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'"
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def printable(content: object) -> str:
    """Anything as text for a page: markup as it is, control characters as �."""
    if isinstance(content, Markup):
        return content
    return _UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", str(content))


PAGES = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1]),  # names begin with a folder of `tools`
    autoescape=True,
    undefined=StrictUndefined,
    finalize=printable,
    extensions=["jinja2.ext.do"],
    trim_blocks=True,
    lstrip_blocks=True,
)
PAGES.filters |= {"count": count, "number": number, "rate": rate, "at": seconds}
PAGES.globals |= {"policy": POLICY, "colours": COLOURS}
