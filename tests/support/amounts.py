"""How many random problems a test tries: few, more with the slow tests, many with the long ones."""

from __future__ import annotations

from typing import Any

import pytest

AMOUNTS = ("few", "more", "many")


def seed_ranges(few: int, more: int, many: int) -> list[Any]:
    """Ranges of seeds, each from the end of the one before, in the order of `AMOUNTS`."""
    slow, long = pytest.mark.slow, pytest.mark.long
    return [
        range(few),
        pytest.param(range(few, more), marks=slow),
        pytest.param(range(more, many), marks=long),
    ]
