"""The example of an agent learns, and repeats itself."""

from __future__ import annotations

import runpy

import numpy as np
import pytest
from support import HOUSE

EXAMPLE = runpy.run_path(str(HOUSE / "examples" / "environment.py"))


@pytest.mark.slow
def test_the_search_finds_better_gains_each_time_and_repeats_itself():
    found = EXAMPLE["search"](tries=5, episodes=1, seed=0)
    values = [value for _, value in found]
    assert len(values) > 1
    assert values == sorted(values)
    assert values[-1] > 0.9 * values[0]  # both are negative
    (again, value), *_ = EXAMPLE["search"](tries=0, episodes=1, seed=0)
    np.testing.assert_array_equal(again, found[0][0])
    assert value == values[0]
