"""What the summary of a run says to people."""

from __future__ import annotations

import pytest

from hoap3.tools.services.run_statistics import RunStatistics
from hoap3.tools.show.summary import show_summary


@pytest.mark.parametrize("complete", [True, False])
def test_nothing_was_asked_is_said_only_where_the_robot_counted(complete, capsys):
    summary = RunStatistics(1_000_000, timing=False).summary()
    summary |= {"complete": complete, "log": None, "machine": {}, "transport": "none"}
    show_summary(summary)
    said = capsys.readouterr().out
    assert ("nothing was asked" in said) == complete
    assert ("count is lost" in said) != complete
