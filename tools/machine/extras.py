"""What some commands need, and a robot's own machine does without."""

from __future__ import annotations

from importlib.util import find_spec

from hoap3.protocol.errors import NotInstalledError


def check_drawing() -> None:
    """Refuse what draws before it begins, where it could not.

    Raises:
        NotInstalledError: jinja2 or matplotlib is not installed.
    """
    for package in ("jinja2", "matplotlib"):
        if find_spec(package) is None:
            raise NotInstalledError("package", package, "'hoap3[report]'")


def check_metrics() -> None:
    """Refuse a service with metrics before it begins, where they could not be served.

    Raises:
        NotInstalledError: prometheus-client is not installed.
    """
    if find_spec("prometheus_client") is None:
        raise NotInstalledError("package", "prometheus-client", "'hoap3[metrics]'")


def check_view() -> None:
    """Refuse the live page before it begins, where it could not be served.

    Raises:
        NotInstalledError: websockets is not installed.
    """
    if find_spec("websockets") is None:
        raise NotInstalledError("package", "websockets", "'hoap3[view]'")
