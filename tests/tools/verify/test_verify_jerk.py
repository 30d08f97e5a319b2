"""`hoap3 verify` knows a robot's limit of jerk: what keeps it is true, and what does not is not."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.command_bench import inside
from tampering import assert_no_false_alarm, changed_field, changed_limit, ran, rewrite

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot that holds its controller back, as this does not know how to begin so gently."""
    given, smooth = ("--robot", "ur5", "--controller", "qp12"), "emulator.setpoint_jerk_max=100"
    return ran(tmp_path_factory.mktemp("story") / "run", *given, sets=[smooth], seconds=0.4)


def test_a_log_with_a_limit_of_jerk_is_true_and_repeats_bit_by_bit(story: Path) -> None:
    found = assert_no_false_alarm(story)

    assert found.claims.counts["applied jerk"].checked > 1000
    assert inside("replay", story).code == 0


JERKED = changed_field(Kind.STATE, 100, "reference", lambda q: q + 3e-7, joint=1)
LESS = changed_limit(1, "setpoint_jerk_max", by=0.01)


@pytest.mark.parametrize("change", [JERKED, LESS], ids=["reference", "limit"])
def test_a_reference_that_jerks_more_than_the_limit_is_found(change, story, tmp_path):
    found = verify(rewrite(story, "robot", tmp_path / "o", change))

    assert found.verdict == "false"
    assert found.claims.counts["applied jerk"].false > 0
