"""A controller that takes a live target outside its range is found, at the tick of the message."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import recorded

from hoap3.protocol.messages import Target
from hoap3.remote_controller.references.live.live import Live
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.targets_taken import check_targets

LIVE = {"kind": "live", "name": "hand", "lower_m": [0.2, -0.2, 0.2], "upper_m": [0.6, 0.3, 0.5]}
HAND = {"task": "frame_position", "parameters": {"frame": "tool0", "target": LIVE}}


def place(number: int, first_tick: int, *position: float) -> bytes:
    target = Target(1, 3)
    target.first_tick, target.number = first_tick, number
    target.values[:] = position
    return target.dump()


@pytest.mark.parametrize("position", [(0.4, 0.1, 0.51), (0.19, 0.1, 0.4)])
def test_a_target_out_of_range_that_was_taken_is_found(position, monkeypatch):
    targets = {4: place(1, 4, 0.4, 0.1, 0.4), 8: place(2, 8, *position)}

    def found() -> Claims:
        records, parameters = recorded("stable_qp", "ur5", 12, targets=targets, task=HAND)
        claims = Claims()
        check_targets(records, parameters, claims)
        return claims

    assert found().counts["live target in range"].false == 0

    def takes_all(self: Live, points: Any) -> bool:
        return bool(np.isfinite(points).all())

    monkeypatch.setattr(Live, "_in_range", takes_all)
    assert [one.tick for one in found().by_tick()] == [7]
