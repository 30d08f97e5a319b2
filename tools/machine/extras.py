"""What some commands need, and a robot's own machine does without."""

from __future__ import annotations

from importlib.util import find_spec

from hoap3.protocol.errors import NotInstalledError


def check_drawing() -> None:
    """Refuse what draws before it begins, where it could not.

    Raises:
        NotInstalledError: matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise NotInstalledError("package", "matplotlib", "'hoap3[report]'")
