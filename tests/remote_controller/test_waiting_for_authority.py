"""A controller reports that it waits for authority; `--duration` counts all its sessions."""

from __future__ import annotations

import json
from typing import Any

import pytest

from hoap3.protocol.answers import GrantAnswer
from hoap3.remote_controller import service as service_module
from hoap3.remote_controller.config import ControllerConfig
from hoap3.remote_controller.service import Service

STATUS = {
    "mode": "idle",
    "stop_reason": None,
    "holder": None,
    "session_id": 7,
    "tick": 0,
    "lockstep": False,
}
REFUSED = {**STATUS, "granted": False, "reason": "no_token", "epoch": None, "from_tick": None}
GRANTED = {**STATUS, "granted": True, "epoch": 1, "from_tick": 3}


class Link:
    """Gives one answer after the other."""

    robot = "arm"

    def __init__(self, answers: list[dict[str, Any]]) -> None:
        self._answers = iter(answers)

    def ask(self, verb: str, body: bytes = b"") -> bytes:
        assert verb == "acquire"
        return json.dumps(next(self._answers)).encode()


@pytest.mark.parametrize("refusals", [0, 1, 3])
def test_waiting_for_authority_is_reported_once(
    refusals: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_module, "RETRY_S", 0.0)
    said: list[str] = []
    config = ControllerConfig(controller="qp12")
    service = Service(config, None, said.append, lambda: False)  # type: ignore[arg-type]
    grant = service._acquire(Link([REFUSED] * refusals + [GRANTED]))  # type: ignore[arg-type]
    assert isinstance(grant, GrantAnswer)
    assert grant.granted
    waits = [text for text in said if "waiting for authority over robot 'arm'" in text]
    assert waits == said
    assert len(waits) == min(refusals, 1)
    assert all("no_token" in text for text in waits)


def test_a_duration_counts_all_sessions() -> None:
    from types import SimpleNamespace

    from hoap3.robot_emulator.robots import load

    service = Service(ControllerConfig(controller="qp12"), None, print, lambda: False)  # type: ignore[arg-type]
    service._controller = SimpleNamespace(description=load("hoap3"))  # type: ignore[assignment]
    service.loop = SimpleNamespace(steps=300)  # type: ignore[assignment]
    assert service._followed_s() == pytest.approx(0.3)
    service._begin_session()
    service.loop = SimpleNamespace(steps=200)  # type: ignore[assignment]
    assert service._followed_s() == pytest.approx(0.5)
