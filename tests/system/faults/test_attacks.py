"""Attacks on a robot, in plain and with certificates: they end as docs/security.md says."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from support import HOUSE
from support.certificates.laboratory import DAY, client, laboratory
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink
from hoap3.protocol.link.zenoh_session import (
    ask,
    key,
    open_session,
    session_name,
    zenoh,
)
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.tools.certs.authority import issue

PATIENCE_S = 10.0
HOLDER = "qp.1"
VICTIMS = 5
TRIES = 20  # of what needs the robot to have heard of something before


class Scene:
    """A robot on virtual time that follows a holder, and attackers who know all that it tells.

    With certificates the attackers are those whom the robot lists and yet gives no right, a second
    controller, and somebody whom it does not list.
    """

    def __init__(self, certs: Path | None) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.threads = ThreadPoolExecutor()
        self.opened: list[Any] = []
        if certs is None:
            endpoint = f"tcp/127.0.0.1:{port}"
            robot = LinkSettings(listen=(endpoint,))
            law = LinkSettings(connect=(endpoint,))
            foes = [("mallory", LinkSettings(connect=(endpoint,), mode="client"))]
        else:
            endpoint = f"tls/127.0.0.1:{port}"
            robot = LinkSettings(listen=(endpoint,), secure=str(certs / "arm"))
            law = client(certs, "qp", endpoint, "peer")
            foes = [(name, client(certs, name, endpoint)) for name in ("otto", "rival", "eve")]
        self.link = self.keep(ZenohRobotLink("arm", robot, blocking=True))
        clock, config = VirtualClock(), EmulatorConfig(robot="arm", misses_to_stop=10**9)
        self.robot = RobotLoop(arm(), config, clock, self.link, MemoryRecorder(), 7)
        self._ticker = Ticker(clock, self.robot.period, 0)
        self.holder = self.keep(ZenohControllerLink("arm", law, HOLDER, blocking=True))
        assert self.holder.presence.wait(PATIENCE_S)
        self.settings = [settings for _, settings in foes]
        self.tool = law.model_copy(update={"mode": "client"})
        self.foes = {
            session_name(settings, "1"): self.keep(open_session(settings, "arm"))
            for name, settings in foes
        }
        ring: Any = zenoh.handlers.RingChannel(4096)  # a queue that is full would block
        self.states = self.holder._session.declare_subscriber(key("arm", "state/2"), ring)

    def keep(self, one: Any) -> Any:
        self.opened.append(one)
        return one

    def step(self) -> None:
        self._ticker.wait()
        self.robot.step(self._ticker)

    def wait(self, condition: Callable[[], Any]) -> Any:
        """Step until something is so."""
        end = time.monotonic() + PATIENCE_S
        while not (found := condition()):
            assert time.monotonic() < end
            self.step()
            os.sched_yield()
        return found

    def during(self, what: Callable[..., Any], *given: Any) -> Any:
        """The result of something that needs the robot to go on."""
        asked = self.threads.submit(what, *given)
        self.wait(asked.done)
        return asked.result()

    def follow(self) -> None:
        """Have the robot follow its holder."""
        self.wait(lambda: b'"granted": true' in (self.during(self.holder.ask, "acquire") or b""))
        self.wait(lambda: self.robot.mode == State.ACTIVE)
        self.wait(lambda: self.holder._setpoint.matching_status.matching)

    def asks(self, verb: str, name: str = "", whom: Any = "ask", body: bytes = b"") -> bytes:
        """What all attackers are answered, in their own names, or in another."""
        answers = [
            self.during(ask, foe, "arm", verb, name or me, body, whom) or b""
            for me, foe in self.foes.items()
        ]
        return b"".join(answers)

    def put(self, leaf: str, payload: bytes) -> None:
        """All attackers publish; afterwards it has arrived, or never will."""
        for me, foe in self.foes.items():
            foe.put(key("arm", leaf.replace("{me}", me)), payload)
            self.during(ask, foe, "arm", "status", me)

    def close(self) -> None:
        for one in reversed(self.opened):
            one.close()
        self.threads.shutdown()


def forged(scene: Scene) -> bytes:
    """An answer to the newest State with a position of the attackers', under the holder's epoch."""
    grant = scene.robot._authority.grant
    setpoint = Setpoint(3)
    setpoint.session_id, setpoint.tick, setpoint.epoch = 7, scene.robot.tick, grant.epoch
    setpoint.values[:] = 0.01
    return setpoint.dump()


def takes_authority(scene: Scene) -> bool:
    tokens = [
        foe.liveliness().declare_token(key("arm", f"clients/{me}"))
        for me, foe in scene.foes.items()
        if not me.startswith("rival")  # who may, where nobody holds it
    ]
    mine = {me: foe for me, foe in scene.foes.items() if not me.startswith("rival")}
    for me, foe in mine.items():
        for _ in range(TRIES):
            if b'"granted": true' in (scene.during(ask, foe, "arm", "acquire", me) or b""):
                return True
    del tokens
    return False


def releases_in_the_holders_name(scene: Scene) -> bool:
    scene.follow()
    return b'"released": true' in scene.asks("release", HOLDER)


def stops(scene: Scene) -> bool:
    scene.follow()
    scene.asks("stop")
    return scene.robot.mode != State.ACTIVE


def recovers(scene: Scene) -> bool:
    scene.follow()
    scene.robot.stop("REASON_COMMAND")
    scene.wait(lambda: scene.robot.mode == State.STOPPED)
    return b'"recovered": true' in scene.asks("recover")


def injects_setpoints(scene: Scene) -> bool:
    scene.follow()
    before = scene.robot.validator.newest_tick
    for leaf in (f"setpoint/{HOLDER}", "setpoint/{me}", "setpoint"):
        scene.put(leaf, forged(scene))
    scene.step()
    return scene.robot.validator.newest_tick > before


def feigns_states(scene: Scene) -> bool:
    scene.follow()
    scene.put("state/2", b"feigned")
    while (sample := scene.states.try_recv()) is not None:
        if sample.payload.to_bytes() == b"feigned":
            return True
    return False


def feigns_descriptions(scene: Scene) -> bool:
    heard: list[str] = []

    def feign(query: Any) -> None:
        heard.append(str(query.key_expr))
        query.reply(query.key_expr, b"feigned")

    for settings in scene.settings:  # as peers, whom a robot passes a client's questions on to
        foe = scene.keep(open_session(settings.model_copy(update={"mode": "peer"}), "arm"))
        scene.during(ask, foe, "arm", "status", session_name(settings, "2"))
        foe.declare_queryable(key("arm", "ask/**"), feign)
        scene.during(ask, foe, "arm", "status", session_name(settings, "2"))
    expression = key("arm", f"ask/description/{session_name(scene.tool, 'tool')}")

    def answers(victim: Any) -> list[bytes]:
        replies = list(victim.get(expression, timeout=2.0))
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok]

    for _ in range(VICTIMS):  # the robot's own answer may be the first
        victim = scene.keep(open_session(scene.tool, "arm"))
        if any(b"feigned" in scene.during(answers, victim) for _ in range(TRIES)):
            return True
    return False


def feigns_presence(scene: Scene) -> bool:
    names = (HOLDER.replace(".1", ".2"), "ghost.1")
    tokens = [
        foe.liveliness().declare_token(key("arm", f"clients/{name}"))
        for foe in scene.foes.values()
        for name in names
    ]
    for me, foe in scene.foes.items():
        scene.during(ask, foe, "arm", "status", me)
    found = scene.link._session.liveliness().get(key("arm", "clients/*"), timeout=2.0)
    seen = {str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in found if reply.ok}
    del tokens
    return bool(seen & set(names))


def replays_setpoints(scene: Scene) -> bool:
    scene.follow()
    old = forged(scene)
    scene.holder.publish(old)
    before = Setpoint.scalars(old, "tick")[0]
    scene.wait(lambda: scene.robot.validator.newest_tick == before)
    scene.put(f"setpoint/{HOLDER}", old)
    scene.step()
    return scene.robot.validator.newest_tick > before


def changes_the_controller(scene: Scene) -> bool:
    scene.asks("change", whom="control", body=b"{}")
    return bool(scene.holder._asked)


def steers(scene: Scene) -> bool:
    scene.put("targets/{me}", b"target")
    return scene.holder.target() is not None


ATTACKS: dict[str, Callable[[Scene], bool]] = {
    "take authority": takes_authority,
    "release in the holder's name": releases_in_the_holders_name,
    "stop": stops,
    "recover": recovers,
    "inject setpoints": injects_setpoints,
    "replay setpoints": replays_setpoints,
    "change the controller": changes_the_controller,
    "steer": steers,
    "feign States": feigns_states,
    "feign the description": feigns_descriptions,
    "feign presence": feigns_presence,
}


def rows() -> dict[str, dict[str, str]]:
    """How the page says that each attack ends, by what it is."""
    page = (HOUSE / "docs" / "security.md").read_text(encoding="utf-8")
    lines = page.partition("## Before and after")[2].partition("\n## ")[0].splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "|" in line]
    return {row[0]: dict(zip(cells[0], row, strict=True)) for row in cells[2:]}


ROWS = rows()


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return laboratory(tmp_path_factory.mktemp("lab") / "certs")


@pytest.fixture
def scene(request, certs, tmp_path) -> Iterator[Scene]:
    if request.param == "plain":
        one = Scene(None)
    else:
        if not (certs / "eve").exists():  # of the same authority, and on no list
            listed = (certs / "arm" / "access.yaml").read_text()
            issue(certs, "eve", "admin", [], DAY)
            (certs / "arm" / "access.yaml").write_text(listed)
        one = Scene(certs)
    yield one
    one.close()


def test_the_table_has_every_attack_that_is_run():
    assert list(ROWS) == list(ATTACKS)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["plain", "certificates"], indirect=True)
@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_ends_as_the_page_says(attack, scene, request):
    how = "plain" if scene.link._guard is None else "with certificates"
    succeeded = ATTACKS[attack](scene)
    assert ROWS[attack][how] == ("succeeds" if succeeded else "refused")
