"""Endpoints of the network, such as `tcp/127.0.0.1:7447`, and what is wrong with what is none."""

from __future__ import annotations

import ipaddress
import re
from typing import Annotated, Self

from pydantic import AfterValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

PATTERN = r"^[a-z][a-z-]*/\S+$"
LARGEST_PORT = 65_535

_PORT = re.compile(r"(?:tcp|udp|tls|quic|ws)/[^?#]*:([0-9]+)(?:[?#].*)?")
_ADDRESS = re.compile(r"[\w.\[\]:-]+:[0-9]{1,5}")
_LINK_LOCAL = re.compile(r"(?:^|(?<=\[))fe[89ab][0-9a-f]:[0-9a-f:]*(?![0-9a-f:%])", re.IGNORECASE)
_ZONE = re.compile(r"([a-z]+/\[[^\]%]+)%([^\]]+)(\]:[0-9]+)")
_EXAMPLE = "127.0.0.1:7447"
_HOST = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?P<host>[^?#]*):[0-9]+(?:[?#].*)?")


class Place(str):
    """An endpoint, and the folder of the certificate with which it is reached.

    Attributes:
        secure: the folder.
    """

    secure: str

    def __new__(cls, endpoint: str, secure: str) -> Self:
        """Of both."""
        place = super().__new__(cls, endpoint)
        place.secure = secure
        return place


def over_tls(endpoint: str) -> str:
    """The same place, reached over TLS."""
    return f"tls/{endpoint.partition('/')[2]}"


def endpoint_fault(text: str) -> tuple[str, str] | None:
    """What is wrong with an endpoint, and the remedy; None where nothing is."""
    if not re.fullmatch(PATTERN, text):
        return "is not an endpoint, which has the form PROTOCOL/ADDRESS:PORT", _meant(text)
    if fault := zone_fault(text):
        return fault
    port = _PORT.fullmatch(text)
    if port is not None and int(port[1].lstrip("0")[:6] or "0") > LARGEST_PORT:
        return f"has a port above {LARGEST_PORT}", f"Choose one from 1 to {LARGEST_PORT}"
    return None


def zone_fault(text: str) -> tuple[str, str] | None:
    """What is wrong with a link-local IPv6 address without a network interface, and the remedy."""
    if "#iface=" in text or not (found := _LINK_LOCAL.search(text)):
        return None
    problem = "is a link-local IPv6 address without a network interface"
    return problem, f"Name one as `ip -6 addr` lists them, such as {found[0]}%eth0"


def beyond_this_machine(endpoint: str) -> bool:
    """Whether other machines may reach who listens at an endpoint."""
    host = _HOST.fullmatch(endpoint)
    if host is None:
        return not endpoint.startswith("unixsock-stream/")
    return not is_loopback(host["host"].strip("[]"))


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this machine's alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def _meant(text: str) -> str:
    """A remedy with what was probably meant as address and port."""
    words = text.replace("://", "/").rpartition("/")[2].strip()
    return f"Write tcp/{words if _ADDRESS.fullmatch(words) else _EXAMPLE}"


def _checked(text: str) -> str:
    fault = endpoint_fault(text)
    if fault is not None:
        problem, remedy = fault
        raise PydanticCustomError("endpoint", "{problem}", {"problem": problem, "remedy": remedy})
    zone = _ZONE.fullmatch(text)  # which Zenoh takes elsewhere
    return f"{zone[1]}{zone[3]}#iface={zone[2]}" if zone else text


Endpoint = Annotated[
    str, AfterValidator(_checked), WithJsonSchema({"type": "string", "pattern": PATTERN})
]
