"""What the page of a log keeps in memory does not grow with the length of the log."""

from __future__ import annotations

import gc
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.view.sources import log_overview
from hoap3.tools.view.sources.log_source import LogSource

SECOND = 1_000_000_000
ROBOT = describe(3)
TICKS = 2500  # of a part, which is longer than what is kept unpacked
PARTS = 8  # of the long log
SHARE = 20  # of what the long log has more, less than one part in so many may be kept


@pytest.fixture(scope="module")
def part() -> list[Record]:
    return ticks(ROBOT.n, TICKS)


def written(folder: Path, part: list[Record], parts: int) -> Path:
    """A log in which the same happens so many times, one after the other."""
    later = [
        Record(kind, stamp + place * TICKS * SECOND // 1000, payload)
        for place in range(parts)
        for kind, stamp, payload in part
    ]
    path = folder / "robot.mcap"
    write(path, [*inputs(ROBOT), *later], attachments={"description.json": ROBOT.to_json()})
    return path


def kept_by(path: Path) -> tuple[int, dict[str, Any]]:
    """Bytes that are held once all was seen and many places were shown, and what a page is told."""
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    source = LogSource([path])
    try:
        assert source.overview.join(300.0)
        player, told = source.player(), source.hello()["log"]
        for at_s in np.random.default_rng(0).uniform(told["from_s"], told["to_s"], 40):
            player.seek(float(at_s))
            player.frame()
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before, told
    finally:
        source.close()


@pytest.mark.slow
def test_a_long_log_is_kept_in_no_more_memory_than_a_short_one(part, tmp_path):
    paths = []
    for parts in (1, PARTS):
        folder = tmp_path / str(parts)
        folder.mkdir()
        paths.append(written(folder, part, parts))
    kept_by(paths[0])  # what is loaded once for all
    tracemalloc.start()
    try:
        short, long = (kept_by(path)[0] for path in paths)
    finally:
        tracemalloc.stop()
    more = (PARTS - 1) * sum(len(record.payload) for record in part)
    assert long - short < more / SHARE


@pytest.mark.slow
def test_a_page_is_told_no_more_of_a_long_log_than_fits_on_it(part, tmp_path):
    tracemalloc.start()
    try:
        _, told = kept_by(written(tmp_path, part, PARTS))
    finally:
        tracemalloc.stop()
    assert told["to_s"] - told["from_s"] == pytest.approx(PARTS * TICKS / 1000, rel=1e-2)
    assert len(told["events"]) == log_overview.EVENTS + 1  # the last counts the others
    assert 0 < len(told["worst"]) <= 2 * log_overview.WORST
    assert told["overview"]
    assert all(len(curve) <= log_overview.BINS for curve in told["overview"].values())
