"""Are the four packages really ours? `protocol` and `tools` are common names."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

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
            sys.path.insert(0, str(house))  # it may be `protocol` that is hidden
            from protocol.errors import ShadowedError  # noqa: PLC0415

            raise ShadowedError(
                f"the package {room!r} found at {found} hides ours at {house / room}: run from "
                "another folder, or take it off PYTHONPATH"
            )
