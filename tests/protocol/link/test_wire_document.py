"""docs/reference/wire.md says what the code does: its answers and its client."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading

import pytest
from loopback import PATIENCE_S, free_endpoint
from support import HOUSE
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.link.zenoh_link import ZenohRobotLink
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import Clock, MonotonicClock, VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import EVENTS, GRACE_TICKS, RobotLoop
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS

PAGE = (HOUSE / "docs" / "reference" / "wire.md").read_text(encoding="utf-8")


def test_numbers_on_the_wire_stay_as_they_are():
    modes = (State.IDLE, State.ACTIVE, State.STOPPING, State.STOPPED)
    assert modes == (0, 1, 2, 3)
    reasons = ("MISSES", "HOLDER_LOST", "COMMAND", "SHUTDOWN", "RELEASED", "ENDED")
    assert [EVENTS[f"REASON_{reason}"] for reason in reasons] == [1, 2, 3, 4, 5, 6]
    refusals = "size layout wire_version session future unasked epoch command not_finite"
    assert list(REJECTION_KINDS) == refusals.split()


class Robot:
    """A whole robot in lockstep, in process or over Zenoh."""

    def __init__(self, clock: Clock, link: object, **config: object) -> None:
        settings = EmulatorConfig(robot="arm", **config)
        description = arm()
        self.loop = RobotLoop(
            description,
            settings,
            clock,
            link,
            NoRecorder(),
            session_id=2**63 - 1,
            grace_ticks=0 if isinstance(clock, VirtualClock) else GRACE_TICKS,
        )


def test_requests_are_answered_as_the_table_says():
    clock = VirtualClock()
    link = LockstepLink(lambda state: None, clock)
    robot = Robot(clock, link)
    asked = [(verb, "a") for verb in ("description", "config", "status", "acquire")]
    asked += [("acquire", "b"), ("release", "b"), ("release", "a"), ("stop", "b")]
    asked += [("recover", "b"), ("recover", "b"), ("dance", "a")]
    answers = [link.ask(*each) for each in asked]
    robot.loop.run(0, lambda: clock.now() > 5_000_000)
    found = [answer for (answer,) in answers]
    assert EmulatorConfig.model_validate_json(found.pop(1)).robot == "arm"
    status = set(json.loads(re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)[1]))
    assert found[0] == arm().to_json()
    assert set(found[1]) == status | {"counts"}
    terms = {"deadline", "delay_ticks", "setpoint_arrays"}
    assert set(found[2]) == {"granted", "epoch", "from_tick"} | terms | status
    assert set(found[3]) == {"granted", "reason"} | status
    assert found[3]["reason"] == "held"
    assert (found[2]["granted"], found[3]["granted"], found[3]["holder"]) == (True, False, "a")
    assert (found[4], found[5]) == ({"released": False}, {"released": True})
    assert set(found[6]) == status
    assert set(found[7]) == set(found[8]) == {"recovered"} | status
    assert (found[7]["recovered"], found[8]["recovered"]) == (True, False)
    assert list(found[9]) == ["error"]


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_client_of_the_page_follows_a_robot(network, tmp_path, lockstep):
    (program,) = re.findall(r"```python\n(import json.*?)```", PAGE, re.DOTALL)
    (tmp_path / "client.py").write_text(program, encoding="utf-8")
    endpoint, ended = free_endpoint(), threading.Event()
    settings = LinkSettings(listen=(endpoint,), lease_ms=30_000)
    if lockstep:
        clock = VirtualClock()
        link = network.keep(
            RemoteLockstepLink(
                ZenohRobotLink("arm", settings, blocking=True),
                clock,
                200_000,
                ended.is_set,
                endless=True,
            )
        )
        robot = Robot(clock, link)
    else:  # in the process of the tests nothing is real time: misses are all right
        clock = MonotonicClock()
        robot = Robot(clock, network.robot(**settings.model_dump()), misses_to_stop=10**9)
    running = network.start(robot.loop.run, clock.now(), ended.is_set)
    try:
        done = subprocess.run(
            [sys.executable, str(tmp_path / "client.py"), endpoint, "arm"],
            capture_output=True,
            timeout=PATIENCE_S,
            check=False,
            text=True,
        )
    finally:
        ended.set()
    running.result(PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"answered": 200, "released": True}
    counts = robot.loop.summary()
    assert counts["rejections"] == {}
    assert counts["safe_stops"] == 0
    if lockstep:  # `release` may come in time for the next tick, or while that waits
        assert counts["in_time"] == 200
        assert counts["asked"] in {200, 201}
