"""`hoap3 verify` finds every event, summary, description, session and stamp that was changed."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from pathlib import Path

import pytest
from tampered_kinds import LOGS, SIDES, changes
from tampering import Change, rewrite

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.replay import replay
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

FOUND = {"false", "not verified", "error"}


@pytest.fixture
def run(tmp_path):
    return LOGS["plain"](tmp_path / "run")


def changed(run: Path, side: str, change: Change) -> Path:
    """A copy of a run beside it, with one log changed."""
    folder = run.parent / "changed"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(run, folder)
    (folder / f"{side}.mcap").unlink()
    rewrite(run, side, folder, change)
    return folder


def _verdict(folder: Path) -> str:
    """The verdict, "" where it names no claim."""
    try:
        found = verify(folder, repeat=True)
    except LogError:  # names the log
        return "error"
    named = found.claims.false or found.claims.unverifiable
    return found.verdict if found.verdict == "true" or named else ""


@pytest.mark.parametrize("log", LOGS)
@pytest.mark.parametrize(
    ("kinds", "places"),
    [(3, 1), pytest.param(1000, 20, marks=[pytest.mark.slow, pytest.mark.long])],
)
def test_each_change_is_found(log: str, kinds: int, places: int, tmp_path: Path) -> None:
    run = LOGS[log](tmp_path / "run")
    assert verify(run, repeat=True).verdict == "true"
    table = Counter[tuple[str, bool]]()
    for side in SIDES:
        found = list(changes(run, side))
        for kind, change in random.Random(log).sample(found, min(kinds, len(found))):
            for place in range(places):
                rng = random.Random(f"{log} {kind} {place}")

                def altered(records: list[Record]) -> list[Record]:
                    change(records, rng)  # noqa: B023
                    return records

                table[kind, _verdict(changed(run, side, altered)) in FOUND] += 1
    for kind in sorted({kind for kind, _ in table}):
        print(f"{kind:<60}{table[kind, True]:>4} / {table[kind, True] + table[kind, False]}")
    assert [kind for kind, found in table if not found] == []


def test_a_config_without_a_record_of_the_other_side_is_not_verified(run):
    folder = changed(run, "robot", lambda found: [r for r in found if r.kind != Kind.CONFIG])
    found = verify(folder, repeat=True)
    assert found.verdict == "not verified"
    assert found.claims.counts["config of the controller"].unverified


def test_setpoints_missing_from_the_log_are_counted(run):
    def shortened(records: list[Record]) -> list[Record]:
        places = [i for i, r in enumerate(records) if r.kind == Kind.SETPOINT][10:60]
        return [r for i, r in enumerate(records) if i not in places]

    folder = changed(run, "controller", shortened)
    report = replay(folder, [])
    assert (report.absent, report.passed) == (50, False)
    assert report.same == report.setpoints
    assert verify(folder, repeat=True).claims.counts["setpoints in the log"].false == 1
