"""Another client that sends setpoints in the holder's name is noticed, and the holder told."""

from __future__ import annotations

import random

import pytest
from loopback import Network, answer_to, eventually, known
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import key, open_session
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import EVENTS, RobotLoop

CONFLICT = EVENTS["CONFLICTING_SETPOINTS"]
SESSION = 7


class Scene:
    """A robot on virtual time, its holder and an intruder, all with sessions of their own."""

    def __init__(self, network: Network) -> None:
        self.link, self.holder = network.pair(blocking=True)
        settings = LinkSettings(connect=(network.endpoint,), mode="client")
        self.intruder = network.keep(open_session(settings))
        eventually(lambda: self.link._events.matching_status.matching, "a listener to events")
        clock, config = VirtualClock(), EmulatorConfig(robot="arm", misses_to_stop=10**9)
        self.robot = RobotLoop(arm(), config, clock, self.link, MemoryRecorder(), SESSION)
        self._ticker = Ticker(clock, self.robot.period, 0)
        asked = network.start(self.holder.ask, "acquire")
        eventually(lambda: self.step() or asked.done(), "the grant")
        while self.robot.mode != State.ACTIVE:
            self.step()
        known(self.link, self.holder)

    def step(self) -> None:
        self._ticker.wait()
        self.robot.step(self._ticker)

    def tick(self) -> bytes:
        """One tick; the holder's answer to it."""
        self.step()
        return answer_to(self.holder, self.robot.tick).dump()

    def race(self, answer: bytes, forged: bytes, *, intruder_first: bool) -> None:
        """Both answers reach the robot, in this order."""
        for first in (intruder_first, not intruder_first):
            before = len(self.link._arrived)
            if first:
                self.intruder.put(key("arm", "setpoint"), forged)
            else:
                self.holder.publish(answer)
            eventually(lambda: len(self.link._arrived) > before, "an answer")  # noqa: B023


def forge(answer: bytes, value: float) -> bytes:
    """What somebody sends who has seen the State, and knows so the session and the epoch."""
    setpoint = Setpoint(3)
    setpoint.load(answer)
    setpoint.values[:] += value
    setpoint.stamp_received = 1
    return setpoint.dump()


@pytest.mark.parametrize("seed", range(3))
def test_whoever_wins_the_holder_is_told(network, seed):
    scene = Scene(network)
    choice = random.Random(seed)
    for _ in range(choice.randrange(3)):
        answer = scene.tick()
        scene.race(answer, answer, intruder_first=choice.random() < 0.5)  # the very same bytes
    attacks = choice.randrange(1, 4)
    for _ in range(attacks):
        answer = scene.tick()
        scene.race(answer, forge(answer, 0.01), intruder_first=choice.random() < 0.5)
    assert scene.robot.validator.conflicting == attacks - 1
    scene.step()
    assert scene.robot.summary()["conflicting"] == attacks
    heard: list[bytes] = []

    def conflicts() -> list[tuple[int, ...]]:
        while (payload := scene.holder.event()) is not None:
            heard.append(payload)
        told = [Event.scalars(payload, "kind", "session_id", "detail") for payload in heard]
        return [rest for kind, *rest in told if kind == CONFLICT]

    assert eventually(conflicts, "the event") == [[SESSION, 1]]  # once, as this takes no second
