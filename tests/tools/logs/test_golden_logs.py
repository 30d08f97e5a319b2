"""Logs of version 1, kept as they were written: a later version reads and repeats them.

The answers were made by kernels that may change since. As long as they do not, a replay gives the
same bits; after that it gives the same numbers to 1e-9.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.replay import replay

GOLDEN = Path(__file__).parent / "golden_v1"
RUNS = ("qp12", "ghc", "clik_sdp")
ANSWERS = 250


@pytest.mark.parametrize("side", ["robot", "controller"])
@pytest.mark.parametrize("run", RUNS)
def test_an_old_log_opens_whole(run: str, side: str) -> None:
    log = Log.open(GOLDEN / run, side=side)

    kinds = [record.kind for record in log.records()]

    assert log.missing == ""
    assert kinds.count(Kind.SETPOINT) == ANSWERS
    assert len(log.states()) >= ANSWERS
    assert len(log.setpoints()) == ANSWERS


@pytest.mark.parametrize("run", RUNS)
def test_an_old_log_is_repeated(run: str) -> None:
    report = replay(GOLDEN / run, [], tolerance=1e-9)

    assert report.setpoints == ANSWERS
    assert report.identical
