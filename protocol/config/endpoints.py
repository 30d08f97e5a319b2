"""Endpoints of the network, such as `tcp/127.0.0.1:7447`, and what is wrong with what is none."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

PATTERN = r"^[a-z][a-z-]*/\S+$"
LARGEST_PORT = 65_535

_PORT = re.compile(r"(?:tcp|udp|tls|quic|ws)/[^?#]*:([0-9]+)(?:[?#].*)?")
_ADDRESS = re.compile(r"[\w.\[\]:-]+:[0-9]{1,5}")
_EXAMPLE = "127.0.0.1:7447"


def endpoint_fault(text: str) -> tuple[str, str] | None:
    """What is wrong with an endpoint, and the remedy; None where nothing is."""
    if not re.fullmatch(PATTERN, text):
        return "is not an endpoint, which has the form PROTOCOL/ADDRESS:PORT", _meant(text)
    port = _PORT.fullmatch(text)
    if port is not None and int(port[1].lstrip("0")[:6] or "0") > LARGEST_PORT:
        return f"has a port above {LARGEST_PORT}", f"Choose one from 1 to {LARGEST_PORT}"
    return None


def _meant(text: str) -> str:
    """A remedy with what was probably meant as address and port."""
    words = text.replace("://", "/").rpartition("/")[2].strip()
    return f"Write tcp/{words if _ADDRESS.fullmatch(words) else _EXAMPLE}"


def _checked(text: str) -> str:
    fault = endpoint_fault(text)
    if fault is not None:
        problem, remedy = fault
        raise PydanticCustomError("endpoint", "{problem}", {"problem": problem, "remedy": remedy})
    return text


Endpoint = Annotated[
    str, AfterValidator(_checked), WithJsonSchema({"type": "string", "pattern": PATTERN})
]
