"""Settings that every test shares: hypothesis without deadlines, reproducible where CI says so."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("local", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile(
    "ci",
    parent=settings.get_profile("local"),
    derandomize=True,
    print_blob=True,
)
settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker run all that starts services, so that no two robots share the machine."""
    for item in items:
        if item.path.parent.name in {"system", "docs"}:
            item.add_marker(pytest.mark.xdist_group("services"))
