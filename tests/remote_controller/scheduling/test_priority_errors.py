"""What is wrong with priorities is told by file, key and value, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, UsageError, located
from hoap3.remote_controller.scheduling.priorities import Priorities, PrioritySettings

ABC = ("hand", "elbow", "posture")
ROWS = [[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]


def priorities(content, names=ABC):
    with located("x.yaml", "priorities"):
        return Priorities(names, parse(PrioritySettings, content, ""))


def at(*changes):
    return {"timeline": [{"at_s": 1.0, "over_s": 2.0, **change} for change in changes]}


BAD_CONFIGS = [
    ({"matrix": [[0.0, 1.5, 0.0], *ROWS[1:]]}, "matrix.0.1", "1.5"),
    ({"matrix": [[0.0, -0.1, 0.0], *ROWS[1:]]}, "matrix.0.1", "-0.1"),
    ({"matrix": [[0.0, float("nan"), 0.0], *ROWS[1:]]}, "matrix.0.1", "nan"),
    ({"matrix": [[0.0, True, 0.0], *ROWS[1:]]}, "matrix.0.1", "True"),
    ({"matrix": [[0.0, "1", 0.0], *ROWS[1:]]}, "matrix.0.1", "'1'"),
    ({"matrix": ROWS[:2]}, "matrix", "2"),
    ({"matrix": [*ROWS[:2], [0.0]]}, "matrix", "1/3"),
    ({"matrix": ROWS, "order": ["hand"]}, "", "matrix"),
    ({"order": ["hand", "elbow"]}, "order", "posture"),
    ({"order": []}, "", "order"),
    ({"order": ["hand", ["elbow", "hand"], "posture"]}, "order", "hand"),
    ({"order": ["hand", "elbo", "posture"]}, "order", "'elbow'"),
    ({"order": ["hand", 3, "posture"]}, "order.1", "3"),
    ({"inactive": ["foot"]}, "inactive", "hand, elbow, posture"),
    ({"inactive": ["hand", "hand"]}, "inactive", "hand"),
    ({"tasks": []}, "tasks", ""),
    (at({"set": [["hand", "elbow", 2]]}), "timeline.0.set.0.2", "2"),
    (at({"set": [["hand", "elbow"]]}), "timeline.0.set.0.2", ""),
    (at({"set": [["hand", "foot", 1]]}), "timeline.0.set.0", "foot"),
    (
        at({"set": [["hand", "elbow", 1], ["hand", "elbow", 0]]}),
        "timeline.0.set.1",
        "elbow",
    ),
    (at({"order": ["hand", "hand"]}), "timeline.0.order", "hand"),
    (at({"remove": "foot"}), "timeline.0.remove", "foot"),
    (at({"remove": ["hand", "hand"]}), "timeline.0.remove", "hand"),
    (at({"insert": "hand"}), "timeline.0.insert", "hand"),
    ({"inactive": ["hand"], **at({"remove": "hand"})}, "timeline.0.remove", "hand"),
    (at({}), "timeline.0", "set, order, insert and remove"),
    (at({"remove": "hand", "order": ["hand"]}), "timeline.0", "set, order"),
    (at({"remove": "hand", "at_s": -1.0}), "timeline.0.at_s", "-1.0"),
    (at({"remove": "hand", "at_s": float("inf")}), "timeline.0.at_s", "inf"),
    (at({"remove": "hand", "over_s": -0.5}), "timeline.0.over_s", "-0.5"),
    (at({"remove": "hand", "over_s": float("nan")}), "timeline.0.over_s", "nan"),
    ({"timeline": [{"remove": "hand"}]}, "timeline.0.at_s", ""),
    (
        at({"set": [["hand", "elbow", 1]]}, {"set": [["elbow", "hand", 0]], "at_s": 2.0}),
        "timeline.1.at_s",
        "timeline.0, 1 s to 3 s",
    ),
    (
        at({"order": ["elbow", "hand"], "at_s": 2.0}, {"remove": "hand"}),
        "timeline.0.at_s",
        "timeline.1, 1 s to 3 s",
    ),
    (
        at({"remove": "hand", "over_s": 0.0}, {"insert": "hand", "over_s": 0.0}),
        "timeline.1.at_s",
        "timeline.0",
    ),
]


@pytest.mark.parametrize(("content", "key", "named"), BAD_CONFIGS)
def test_a_wrong_config_is_one_named_error(content, key, named):
    with pytest.raises(ConfigError) as caught:
        priorities(content)
    assert caught.value.file == "x.yaml"
    assert caught.value.key == f"priorities.{key}".rstrip(".")
    assert named in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "changes",
    [
        at({"set": [["hand", "elbow", 1]]}, {"set": [["posture", "elbow", 0]]}),
        at({"set": [["hand", "elbow", 1]]}, {"set": [["hand", "elbow", 0]], "at_s": 3.0}),
        at({"remove": "hand"}, {"insert": "hand", "at_s": 4.0}),
        at({"set": [["hand", "hand", 1]]}, {"set": [["elbow", "hand", 0]]}),
    ],
)
def test_different_pairs_may_overlap_and_one_change_begin_where_another_ends(changes):
    assert priorities(changes).names == ABC


BAD_REQUESTS = [
    ({"set": [["hand", "elbow", 1.5]]}, "1.5"),
    ({"set": [["hand", "elbow", float("nan")]]}, "nan"),
    ({"set": [["hand", "foot", 0.5]]}, "hand, elbow, posture"),
    ({"set": [["posture", "hand", 1.0], ["elbow", "foot", 0.5]]}, "'foot'"),
    ({"set": [["hand", "elbow", 0.5]], "over_s": -1}, "over_s"),
    ({"set": [["hand", "elbow", 0.5]], "at_s": 1.0}, "at_s"),
    ({"set": "hand"}, "set"),
    ({"order": ["hand", "hand"]}, "'hand'"),
    ({"insert": "hand"}, "'hand'"),
    ({"remove": ["elbow", "foot"]}, "'foot'"),
    ({"remove": "posture", "insert": "posture"}, "set, order"),
    ({"over_s": 1.0}, "set, order"),
    ({"order": ["hand"]}, "order"),
    ({"order": [["hand"]]}, "order"),
    ({"order": [0] * 9000}, "order.0"),
    ({"order": ["hand"] * 101}, "100"),
    ({}, "set, order"),
    ("hand", "'hand'"),
    (None, "priorities"),
]


@pytest.mark.parametrize(("request_", "word"), BAD_REQUESTS)
def test_a_wrong_live_change_is_a_named_error_and_changes_nothing(request_, word):
    moved = priorities({"order": list(ABC)})
    before = moved.alpha.copy()
    with pytest.raises(UsageError, match=r"^change of priorities") as caught:
        moved.change(request_, 0.5)
    assert word in str(caught.value)
    assert not moved.moving
    moved.update(9.0)
    assert np.array_equal(moved.alpha, before)
