"""What all fuzzers are given."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fuzzing import Findings, bounded


@pytest.fixture
def findings(tmp_path: Path) -> Iterator[Findings]:
    """A note of findings, within bounds of memory."""
    with bounded():
        yield Findings(tmp_path)
