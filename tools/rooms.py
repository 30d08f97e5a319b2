"""Are the four packages really ours? `protocol` and `tools` are common names."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from protocol.errors import ShadowedError

ROOMS = ("protocol", "robot_emulator", "remote_controller", "tools")


def check_rooms() -> None:
    """Refuse to start where another package hides one of ours.

    Raises:
        ShadowedError: names both places.
    """
    house = Path(__file__).resolve().parent.parent
    for room in ROOMS:
        spec = find_spec(room)
        found = Path(spec.origin).resolve().parent if spec and spec.origin else None
        if found != house / room:
            raise ShadowedError(
                f"the package {room!r} found at {found} hides ours at {house / room}: run from "
                "another folder, or take it off PYTHONPATH"
            )
