"""Errors beside each other have the unit that their tasks have, where it is one."""

from __future__ import annotations

import pytest

from hoap3.tools.analysis.compare.comparison import compare
from hoap3.tools.analysis.compare.page import unit

POSTURE = "clik_sdp@tasks=[{task: posture}]"


@pytest.mark.parametrize(
    ("controllers", "expected"),
    [
        (["qp12", "pinv"], "m · s"),
        ([POSTURE, f"again={POSTURE}"], "rad · s"),
        (["qp12", POSTURE], "unit of the task · s"),
    ],
)
def test_errors_have_a_unit_where_all_have_the_same(controllers, expected):
    made = compare(controllers, "ur5", 0.01, timing=False)
    assert unit("unit of the task · s", made) == expected
