"""Figures of a robot that says for itself what is late: from its log, and in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.tick_story import MS, Story

from hoap3.tools.show.verdicts import deadline_words
from hoap3.tools.timing.tick_logs import Cycles, RobotSide
from hoap3.tools.timing.tick_metrics import tick_figures
from hoap3.tools.timing.ticks import LATE, TickTable


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("rule", ["next_tick", "after_receipt"])
def test_the_table_counts_from_where_the_rule_does(tmp_path, rule, delay):
    """A wake-up late by 0.5 ms leaves too little on the schedule for an answer of 0.7 ms."""
    story = Story(100).slow("wakeup", [40], 500.0).slow("solve", [40], 600.0)
    for tick in (60, 61):
        story.slow("outbound", [tick], 1000.0 + 1000.0 * delay)
    side = RobotSide.read(story.write(tmp_path))
    side = replace(side, due=(1 + delay) * MS, from_publication=rule == "after_receipt")
    table = TickTable.of(side, Cycles.read(tmp_path, side))
    late = [60, 61] if delay or rule == "after_receipt" else [40, 60, 61]
    assert table.tick[table.outcome == LATE].tolist() == late
    begin = table.published if rule == "after_receipt" else table.intended
    assert np.array_equal(table.end - begin, np.full(len(table), (1 + delay) * MS))
    assert table.rule == {"deadline": rule, "delay_ticks": delay}
    assert table.rule.items() <= tick_figures([table]).items()


def test_words_say_what_is_not_usual():
    assert deadline_words({"deadline": "next_tick", "delay_ticks": 0}) is None
    assert deadline_words({"deadline": "after_receipt", "delay_ticks": 0}) == (
        "a period after the publication of its State"
    )
    assert deadline_words({"deadline": "next_tick", "delay_ticks": 3}) == (
        "4 periods after the begin of its tick; applied 3 ticks later"
    )
