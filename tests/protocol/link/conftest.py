"""Real sessions for the tests of links."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from loopback import Network


@pytest.fixture
def network() -> Iterator[Network]:
    """Links on loopback; closed at the end of the test."""
    made = Network()
    yield made
    made.close()
