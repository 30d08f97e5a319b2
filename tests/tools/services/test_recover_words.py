"""What `hoap3 recover` prints once it has followed the robot."""

from __future__ import annotations

from typing import Any

import pytest

from hoap3.protocol.errors import LinkError
from hoap3.tools.cli import requests
from hoap3.tools.services import find_robot

IDLE = {
    "robot": "arm",
    "mode": "idle",
    "holder": None,
    "stop_reason": None,
    "name_conflicts": 0,
    "session_id": 7,
    "endpoint": "tcp/127.0.0.1:7447",
    "pid": 1,
}
ACTIVE = {**IDLE, "mode": "active", "holder": "qp12-1"}


@pytest.mark.parametrize(
    ("later", "shown"),
    [
        ([IDLE, IDLE, ACTIVE], "arm: active, follows qp12-1"),
        ([], "arm: idle, no controller; start one to move it"),
    ],
)
def test_the_state_that_a_recovered_robot_comes_to_is_printed(
    later: list[dict[str, Any]],
    shown: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    states = iter(later)

    def answer(robot: str | None, verb: str, _: str | None) -> tuple[list[Any], list[str]]:
        if verb == "recover":
            return [{**IDLE, "recovered": True}], []
        if state := next(states, None):
            return [state], []
        raise LinkError("gone")

    monkeypatch.setattr(find_robot, "ask_robots", answer)
    monkeypatch.setattr(requests, "LOOK_S", 0.0)
    requests.show_answers("arm", "recover", None, as_json=False)
    assert capsys.readouterr().out.splitlines() == [shown]
