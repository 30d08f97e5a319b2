"""A robot with certificates, for the tests of a module."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.certificates.secured_arm import secured_arm


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("lab") / "certs"


@pytest.fixture(scope="module")
def secured(certs) -> Iterator[str]:
    with secured_arm(certs) as at:
        yield at
