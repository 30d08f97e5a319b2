"""A laboratory's certificates: one of each role, and a second controller."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

from hoap3.protocol.config.settings import LinkSettings
from hoap3.tools.services.certificates import init, issue

DAY = timedelta(days=1)
PEOPLE = {
    "qp": "controller",
    "rival": "controller",
    "anna": "operator",
    "otto": "observer",
    "chief": "admin",
}


def laboratory(folder: Path, robot: str = "arm", hosts: Sequence[str] = ()) -> Path:
    """A new authority with a robot, reached at these hosts, and `PEOPLE`; the folder of theirs."""
    init(folder, DAY)
    issue(folder, robot, "robot", hosts, DAY)
    for name, role in PEOPLE.items():
        issue(folder, name, role, [], DAY)
    return folder


def client(folder: Path, name: str, endpoint: str, mode: str = "client") -> LinkSettings:
    """Settings of a session with somebody's certificate."""
    return LinkSettings(connect=(endpoint,), mode=mode, secure=str(folder / name))
