"""What `hoap3 change` takes as words, before any robot is asked, and what it prints."""

from __future__ import annotations

import pytest

from hoap3.protocol.errors import UsageError
from hoap3.tools.cli.requests import change
from hoap3.tools.services.sent import describe_change


@pytest.mark.parametrize(
    ("word", "remedy"),
    [
        *((word, "KEY=VALUE") for word in ("gama", "0.8", '"gamma"', "", "=0.8")),
        *((word, "JSON") for word in ("{", "[1]", ' {"gamma": }')),
    ],
)
def test_a_word_that_is_neither_is_refused(word: str, remedy: str) -> None:
    with pytest.raises(UsageError, match=remedy):
        change([word])


def test_each_changed_value_stands_behind_the_old_one() -> None:
    before = {
        "gamma": 0.1 + 0.2,
        "tasks": {"hand": {"gain_per_s": 1.0}, "foot.left": {"axes": [1.0, 2.0]}},
        "weights": {"weights": {"hand": 2.0}, "moving": False},
        "priorities": {"names": ["hand"], "alpha": [[0]]},
    }
    content = {
        "gamma": 0.8,
        "tasks.hand.gain_per_s": 2,
        "tasks": {"foot.left": {"axes": [3, 4]}, "0": {"gain_per_s": 5.0}},
        "weights": {"hand": 3.0},
        "order": ["hand", "foot"],
        "over_s": 2.0,
    }
    assert describe_change(content, before) == [
        "gamma: 0.3 → 0.8",
        "tasks.hand.gain_per_s: 1 → 2",
        "tasks.foot.left.axes: [1.0, 2.0] → [3, 4]",
        "tasks.0.gain_per_s: 5",
        "weights.hand: 2 → 3",
        'order: ["hand", "foot"]',
    ]
