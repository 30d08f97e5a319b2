"""The extra `peers` has every solver that only the benchmarks use."""

from __future__ import annotations

import re
import tomllib

from support import HOUSE

from benchmarks import qp_peers, sdp_backends

PROJECT = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def named(requirements: list[str]) -> set[str]:
    """Packages of a list of requirements."""
    return {re.split("[<>=]", each)[0] for each in requirements}


def test_an_extra_brings_every_solver_that_does_not_come_by_itself() -> None:
    compared = {*qp_peers.PACKAGES.values(), *sdp_backends.PACKAGES.values()}
    extra = named(PROJECT["optional-dependencies"]["peers"])
    compared.remove("quadprog")  # under the GPL: only the tests' extra has it
    assert extra == compared - named(PROJECT["dependencies"])
