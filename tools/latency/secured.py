"""Both sides with certificates that exist only for a measurement."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

from hoap3.tools.certs.authority import init, issue
from hoap3.tools.machine.loopback_links import LinkPair, free_port

TLS = "tls"
VALID = timedelta(days=1)
CONTROLLER = "latency_controller"


@contextmanager
def secured(robot: str) -> Iterator[LinkPair]:
    """Settings for both sides; their certificates exist until this ends.

    Raises:
        NotInstalledError: cryptography is not installed.
    """
    endpoint = f"{TLS}/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory(prefix="hoap3-certs-") as folder:
        certs = Path(folder)
        init(certs, VALID)
        issue(certs, robot, "robot", [], VALID)
        issue(certs, CONTROLLER, "controller", [], VALID)
        yield (
            {"listen": (endpoint,), "secure": str(certs / robot)},
            {"connect": (endpoint,), "secure": str(certs / CONTROLLER)},
        )
