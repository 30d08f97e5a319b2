"""`hoap3 verify` knows a robot's limit of jerk: what keeps it is true, and what does not is not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.command_bench import inside
from tampering import changed_field, nth, rewrite

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.verify.verify import verify

SMOOTH = "--set", "emulator.setpoint_jerk_max=100"


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot that holds its controller back, as this does not know how to begin so gently."""
    folder = tmp_path_factory.mktemp("story") / "run"
    given = "--robot", "ur5", "--controller", "qp12", "--duration", "0.4"
    inside("run", "--lockstep", *given, *SMOOTH, "--out", folder)
    return folder


def test_a_log_with_a_limit_of_jerk_is_true_and_repeats_bit_by_bit(story: Path) -> None:
    found = verify(story)

    assert found.claims.by_tick() == []
    assert found.verdict == "true"
    assert found.claims.counts["applied jerk"].checked > 1000
    assert inside("replay", story).code == 0


def test_a_reference_that_jerks_more_is_found(story: Path, tmp_path: Path) -> None:
    changed = changed_field(Kind.STATE, 100, "reference", lambda q: q + 3e-7, joint=1)

    found = verify(rewrite(story, "robot", tmp_path / "o", changed))

    assert found.verdict == "false"
    assert found.claims.counts["applied jerk"].false > 0


def test_a_limit_that_is_less_than_the_log_shows_is_found(story: Path, tmp_path: Path) -> None:
    def less(records: list[Record]) -> list[Record]:
        place = nth(records, Kind.DESCRIPTION, 0)
        description = json.loads(records[place].payload)
        description["joints"][1]["setpoint_jerk_max"] *= 0.99
        payload = json.dumps(description).encode()
        records[place] = records[place]._replace(payload=payload)
        return records

    found = verify(rewrite(story, "robot", tmp_path / "o", less))

    assert found.verdict == "false"
    assert found.claims.counts["applied jerk"].false > 0
