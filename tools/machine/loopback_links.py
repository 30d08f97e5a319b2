"""The links that `hoap3 latency` can measure: how both sides reach each other on this machine.

Everything stays on loopback, on a port or a path that nobody uses.
"""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.errors import UsageError

ZENOH = ("tcp", "udp", "unixsock")
LINKS = (*ZENOH, "hoap3_tcp")
LinkPair = tuple[dict[str, Any], dict[str, Any]]
"""Changes of `link` in the settings of a robot and of its controller."""


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of this machine that was free a moment ago."""
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def link(name: str) -> Iterator[LinkPair]:
    """Settings for both sides; what the link needs exists until this ends.

    Args:
        name: one of `LINKS`.

    Raises:
        UsageError: no such link.
    """
    if name not in LINKS:
        raise UsageError(f"--link: no link is called {name!r}. Choose one of {', '.join(LINKS)}")
    if name == "hoap3_tcp":
        ports = Hoap3TcpSettings(init_port=free_port(), control_port=free_port())
        yield {"kind": name, "hoap3_tcp": ports}, {"kind": name, "hoap3_tcp": ports}
        return
    with tempfile.TemporaryDirectory(prefix="hoap3-") as folder:
        if name == "unixsock":
            endpoint = f"unixsock-stream/{folder}/link"
        else:
            kind = socket.SOCK_STREAM if name == "tcp" else socket.SOCK_DGRAM
            endpoint = f"{name}/127.0.0.1:{free_port(kind)}"
        yield {"listen": (endpoint,)}, {"connect": (endpoint,)}
