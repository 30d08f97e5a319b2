"""The secure profile on real sessions: what each role gets through, and what nobody does."""

from __future__ import annotations

import socket
import ssl
import sys
import threading
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from loopback import Network, answer_to, eventually, free_endpoint, known
from support.certificates.laboratory import PEOPLE, client, laboratory
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.link import zenoh_guard
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.zenoh_guard import Guard
from hoap3.protocol.link.zenoh_link import ZenohControllerLink
from hoap3.protocol.link.zenoh_session import (
    ask,
    certified_peers,
    key,
    open_session,
    session_name,
    zenoh,
)
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.secure.access import read_access
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.tools.services.certificates import renew, revoke

VERBS = ("acquire", "config", "description", "recover", "release", "status", "stop", "*")
CONTROL_VERBS = ("about", "acquire", "change", "release", "show", "tasks", "*")
READS = {"ask/config", "ask/description", "ask/status"}
MAY = {
    "controller": READS | {"ask/acquire", "ask/release", "setpoint", "sampled/setpoint"},
    "operator": READS | {"ask/stop", "targets"},
    "observer": READS,
    "admin": READS | {"ask/recover", "ask/release", "ask/stop"},
}
"""What of all that is tried below reaches the robot itself, from each role."""
MAY_ASK_CONTROLLER = {"about", "show", "tasks"}
OPERATES = {"acquire", "change", "release"}


@dataclass
class Ears:
    """A robot's session that notes whatever reaches it."""

    endpoint: str
    session: Any
    heard: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.session.declare_subscriber("robots/**", self._note)
        self.session.declare_queryable(key("arm", "ask/**"), self._asked)
        self.session.liveliness().declare_subscriber("robots/**", self._note)

    def _note(self, sample: Any) -> None:
        self.heard.append(str(sample.key_expr))

    def _asked(self, query: Any) -> None:
        self.heard.append(str(query.key_expr))
        query.reply(query.key_expr, b"the robot")


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return laboratory(tmp_path_factory.mktemp("lab") / "certs")


@pytest.fixture
def ears(certs, network) -> Ears:
    endpoint = free_endpoint().replace("tcp/", "tls/")
    settings = LinkSettings(listen=(endpoint,), secure=str(certs / "arm"))
    return Ears(endpoint, network.keep(open_session(settings, "arm")))


def everything(names: tuple[str, ...]) -> list[str]:
    """Keys that a robot listens to, in each of these names, and in none as in version 1."""
    leaves = [f"ask/{verb}" for verb in VERBS]
    leaves += ["setpoint", "sampled/setpoint", "targets", "state", "sampled/state", "events"]
    return [f"{leaf}/{name}" for name in names for leaf in leaves] + leaves


def try_all(session: Any, me: str) -> None:
    """Everything, in our own name and in others'; afterwards all of it has arrived, or never will.

    Zenoh keeps the order of what has one priority, so an answer to the last question says so.
    """
    own = me.partition(".")[0]
    for leaf in everything((me, "qp.1", f"{own}x.1", own, "*")):
        if leaf.startswith("ask/"):
            list(session.get(key("arm", leaf), timeout=2.0))
        elif "*" not in leaf:
            session.put(key("arm", leaf), b"forged")
    assert list(session.get(key("arm", f"ask/status/{me}"), timeout=5.0))


@pytest.mark.parametrize("name", [name for name in PEOPLE if name != "rival"])
def test_a_role_gets_through_what_it_may_in_its_own_name_and_nothing_else(
    name, certs, network, ears
):
    settings = client(certs, name, ears.endpoint)
    me = session_name(settings, "1")
    session = network.keep(open_session(settings, "arm"))
    try_all(session, me)
    allowed = {key("arm", f"{leaf}/{me}") for leaf in MAY[PEOPLE[name]]}
    eventually(lambda: set(ears.heard) >= allowed, "what is allowed")  # by another thread
    assert set(ears.heard) == allowed


def test_a_token_is_the_clients_own_or_nobodys(certs, network, ears):
    for name in ("anna", "otto"):
        session = network.keep(open_session(client(certs, name, ears.endpoint), "arm"))
        leaves = ("alive", "clients/qp.1", f"clients/{name}x.1", f"clients/{name}.1")
        tokens = [session.liveliness().declare_token(key("arm", leaf)) for leaf in leaves]
        eventually(lambda: key("arm", f"clients/{name}.1") in ears.heard, "the token")  # noqa: B023
        assert list(session.get(key("arm", f"ask/status/{name}.1"), timeout=5.0))
        del tokens
    tokens_seen = {each for each in ears.heard if "/ask/" not in each}
    assert tokens_seen == {key("arm", "clients/anna.1"), key("arm", "clients/otto.1")}


@pytest.mark.parametrize("leaf", ["state/2", "events", "sampled/state/2"])
def test_nobody_feigns_what_the_robot_says(leaf, certs, network, ears):
    reader = network.keep(open_session(client(certs, "otto", ears.endpoint), "arm"))
    heard = reader.declare_subscriber(key("arm", leaf), zenoh.handlers.FifoChannel(9))
    robot = ears.session.declare_publisher(key("arm", leaf))
    eventually(lambda: robot.matching_status.matching, "a reader")
    for name in ("anna", "chief", "qp"):
        session = network.keep(open_session(client(certs, name, ears.endpoint), "arm"))
        session.put(key("arm", leaf), b"feigned")
        assert list(session.get(key("arm", f"ask/status/{name}.1"), timeout=5.0))
    robot.put(b"true")
    assert heard.recv().payload.to_bytes() == b"true"


def test_only_the_robot_answers_for_itself_and_only_a_controller_for_a_controller(
    certs, network, ears
):
    def answers(by: str) -> Any:
        return lambda query: query.reply(query.key_expr, by.encode())

    asker = network.keep(open_session(client(certs, "chief", ears.endpoint), "arm"))
    for name in ("anna", "qp"):
        session = network.keep(open_session(client(certs, name, ears.endpoint, "peer"), "arm"))
        eventually(lambda: name in certified_peers(ears.session), "a connection")  # noqa: B023
        for whom in ("ask", "control"):
            session.declare_queryable(key("arm", f"{whom}/**"), answers(name))
    reply = eventually(lambda: ask(asker, "arm", "show", "chief.1", whom="control"), "an answer")
    assert reply == b"qp"
    replies = list(asker.get(key("arm", "ask/description/chief.1"), timeout=2.0))
    assert [reply.ok.payload.to_bytes() for reply in replies] == [b"the robot"]


@pytest.mark.parametrize("name", ["anna", "otto"])
def test_of_a_controller_an_operator_asks_more_than_an_observer(name, certs, network, ears):
    heard = []
    law = network.keep(open_session(client(certs, "qp", ears.endpoint, "peer"), "arm"))

    def asked(query: Any) -> None:
        heard.append(str(query.key_expr).split("/")[3])
        query.reply(query.key_expr, b"yes")

    law.declare_queryable(key("arm", "control/**"), asked)
    session = network.keep(open_session(client(certs, name, ears.endpoint), "arm"))
    eventually(lambda: ask(session, "arm", "show", f"{name}.1", whom="control"), "an answer")
    for verb in CONTROL_VERBS:
        for me in (f"{name}.1", "chief.1"):
            list(session.get(key("arm", f"control/{verb}/{me}"), timeout=2.0))
    assert set(heard) == MAY_ASK_CONTROLLER | (OPERATES if name == "anna" else set())


def test_a_robot_of_another_name_is_not_listened_to(certs, network, ears):
    session = network.keep(open_session(client(certs, "otto", ears.endpoint), "leg"))
    assert ask(session, "arm", "status", "otto.1") is None


@pytest.mark.parametrize(
    ("name", "robot", "listens", "said"),
    [
        ("qp", "arm", True, "a robot listens"),
        ("arm", "leg", True, "is called 'leg'"),
        ("arm", "arm", False, "does not connect"),
    ],
)
def test_a_certificate_serves_its_own_purpose_alone(name, robot, listens, said, certs):
    endpoint = free_endpoint().replace("tcp/", "tls/")
    places = {"listen" if listens else "connect": (endpoint,)}
    with pytest.raises(ConfigError, match=said):
        open_session(LinkSettings(**places, secure=str(certs / name)), robot)


@pytest.mark.parametrize("whose", ["nobody's", "another authority's"])
def test_without_a_certificate_of_the_authority_there_is_no_session(whose, certs, ears, tmp_path):
    context = ssl.create_default_context(cafile=str(certs / "ca.pem"))
    if whose != "nobody's":
        other = laboratory(tmp_path / "other")
        context.load_cert_chain(other / "chief" / "cert.pem", other / "chief" / "key.pem")
    place = "127.0.0.1", int(ears.endpoint.rpartition(":")[2])
    with socket.create_connection(place) as plain, pytest.raises(ssl.SSLError, match="ALERT"):  # noqa: SIM117
        with context.wrap_socket(plain, server_hostname="127.0.0.1") as secured:
            secured.recv(1)
    assert certified_peers(ears.session) == set()


@pytest.mark.slow
@pytest.mark.parametrize(("whose", "stay"), [("anna", {"otto"}), ("arm", set())])
def test_a_live_connection_ends_with_the_certificate_of_either_side(whose, stay, network, tmp_path):
    folder = laboratory(tmp_path / "certs")
    renew(folder, whose, timedelta(seconds=5))
    endpoint = free_endpoint().replace("tcp/", "tls/")
    settings = LinkSettings(listen=(endpoint,), secure=str(folder / "arm"))
    robot = network.keep(open_session(settings, "arm"))
    for name in ("otto", "anna"):
        network.keep(open_session(client(folder, name, endpoint), "arm"))
    assert certified_peers(robot) == {"otto", "anna"}
    eventually(lambda: certified_peers(robot) == stay, "the end")


class Scene:
    """A robot on virtual time, its holder, and another controller, all with certificates."""

    def __init__(self, network: Network, certs: Path) -> None:
        self.endpoint = free_endpoint().replace("tcp/", "tls/")
        self.network = network
        self.link = network.robot(listen=(self.endpoint,), secure=str(certs / "arm"), blocking=True)
        self.holder, self.rival = (self.controller(certs, name) for name in ("qp", "rival"))
        clock, config = VirtualClock(), EmulatorConfig(robot="arm", misses_to_stop=10**9)
        self.robot = RobotLoop(arm(), config, clock, self.link, MemoryRecorder(), 7)
        self._ticker = Ticker(clock, self.robot.period, 0)
        asked = self.asked(self.holder, "acquire")
        assert b'"granted": true' in asked
        while self.robot.mode != State.ACTIVE:
            self.step()
        for each in (self.holder, self.rival):
            known(self.link, each)

    def controller(self, certs: Path, name: str) -> ZenohControllerLink:
        settings = client(certs, name, self.endpoint, "peer")
        link = ZenohControllerLink("arm", settings, session_name(settings, "1"), blocking=True)
        assert self.network.keep(link).presence.wait(30.0)
        assert link.wait() is None
        return link

    def step(self) -> None:
        self._ticker.wait()
        self.robot.step(self._ticker)

    def asked(self, link: ZenohControllerLink, verb: str) -> bytes:
        """What the robot answers, which it does between two ticks."""
        asked = self.network.start(link.ask, verb)
        eventually(lambda: self.step() or asked.done(), "an answer")
        return asked.result() or b""

    def answers(self) -> tuple[bytes, bytes]:
        """An answer to the newest State, and another one that whoever reads it can make."""
        self.step()
        setpoint = answer_to(self.holder, self.robot.tick)
        answer = setpoint.dump()
        setpoint.values[:] += 0.01
        return answer, setpoint.dump()


@pytest.fixture
def own_certs(tmp_path) -> Path:
    return laboratory(tmp_path / "certs")


def test_a_setpoint_counts_on_the_holders_key_alone(own_certs, network):
    scene = Scene(network, own_certs)
    for _ in range(3):
        answer, forged = scene.answers()
        before = scene.link.counts()["not_holder"]
        scene.rival.publish(forged)
        eventually(lambda: scene.link.counts()["not_holder"] > before, "a setpoint")  # noqa: B023
        scene.holder.publish(answer)
        eventually(lambda: scene.link._arrived, "the holder's")
        scene.step()
    validator = scene.robot.validator
    assert validator.conflicting == validator.rejected == 0
    assert validator.newest_tick >= 0


def test_who_is_revoked_goes_at_once_and_the_others_stay(own_certs, network):
    scene = Scene(network, own_certs)
    revoke(own_certs, "qp")
    session = scene.link._session
    eventually(lambda: scene.step() or scene.robot.mode == State.STOPPED, "a safe stop")
    assert "rival" in certified_peers(session)
    assert b'"granted": true' not in scene.asked(scene.holder, "acquire")
    assert b'"granted": true' in scene.asked(scene.rival, "acquire")


OPENED: list[tuple[str, str]] = []
"""What any thread of this process opens, once the hook is there: its name and the file's."""


def test_the_list_is_read_beside_the_loop_which_opens_nothing(own_certs, network):
    scene = Scene(network, own_certs)
    file = own_certs / "arm" / "access.yaml"
    listed, loop = read_access(file.parent), threading.current_thread().name
    sys.addaudithook(
        lambda event, given: (
            event == "open" and OPENED.append((threading.current_thread().name, str(given[0])))
        )
    )
    ticks = scene.robot.tick
    for access in (listed.without("otto"), listed):
        before = scene.link._guard._roles
        network.start(file.write_text, access.to_yaml()).result()
        OPENED.clear()
        eventually(lambda: scene.step() or scene.link._guard._roles is not before, "a look")  # noqa: B023
        readers = {thread for thread, opened in OPENED if opened == str(file)}
        assert readers == {"access"}
        assert loop not in {thread for thread, _ in OPENED}
    assert scene.robot.tick > ticks + 100


def test_another_role_counts_from_the_next_start_on_however_often_the_list_is_written(own_certs):
    """Until then Zenoh's rules are those of the old one."""
    file, said, answers = own_certs / "arm" / "access.yaml", [], []
    links = SimpleNamespace(info=SimpleNamespace(links=list))
    guard = Guard(links, str(file.parent), said.append)

    def asks(verb):
        return guard.admitted(Request(verb, "anna.1", answers.append)) is not None

    assert asks("stop")
    listed = yaml.safe_load(file.read_text())
    for others in ([], ["new"]):
        changed = {**listed, "operators": [], "observers": ["anna", *others]}
        file.write_text(yaml.safe_dump(changed))
        guard._look()
        assert not asks("stop")
        assert not asks("status")
    file.write_text(yaml.safe_dump(listed))
    guard._look()
    assert asks("stop")
    assert "anna" in said[0]


def test_setpoints_of_a_holder_that_was_revoked_count_no_more(own_certs):
    links = SimpleNamespace(info=SimpleNamespace(links=list))
    guard = Guard(links, str(own_certs / "arm"), lambda _: None)
    admitted = guard.admitted(Request("acquire", "qp.1", lambda _: None))
    admitted.answer({"granted": True})
    assert guard.follows("qp.1")
    assert not guard.follows("qp.2")
    revoke(own_certs, "qp")
    guard._look()
    assert not guard.follows("qp.1")


def test_a_list_that_is_wrong_changes_nothing(own_certs, network):
    scene, said = None, []
    file = own_certs / "arm" / "access.yaml"
    scene = Scene(network, own_certs)
    scene.link._guard._report = said.append
    file.write_text("controllers: [qp, qp]\n")
    eventually(lambda: said, "a word about it")
    assert "access.yaml" in said[0]
    assert b'"holder": "qp.1"' in scene.asked(scene.rival, "status")


def test_an_admin_releases_whoever_holds_authority(own_certs, network):
    scene = Scene(network, own_certs)
    session = network.keep(open_session(client(own_certs, "chief", scene.endpoint), "arm"))
    asked = network.start(ask, session, "arm", "release", "chief.1")
    eventually(lambda: scene.step() or asked.done(), "an answer")
    assert b'"released": true' in asked.result()
    assert b'"granted": true' in scene.asked(scene.rival, "acquire")


class Links:
    """What Zenoh tells of connections: one, of `name`."""

    def __init__(self, name: str) -> None:
        self.info = self
        self.link = SimpleNamespace(auth_identifier=name, dst="tls/127.0.0.1:4711")

    def links(self):
        return [self.link]


def test_while_the_list_cannot_be_read_who_left_it_before_is_closed_still(own_certs, monkeypatch):
    file, said, closed = own_certs / "arm" / "access.yaml", [], []
    monkeypatch.setattr(zenoh_guard, "shut_down", lambda peer: closed.append(peer) or 1)
    guard = Guard(Links("anna"), str(file.parent), said.append)
    revoke(own_certs, "anna")
    assert guard._look() == ""
    file.write_text("controllers: [qp, qp]\n")
    guard.start()
    try:
        eventually(lambda: len(closed) > 1 and said, "a look, and another one")
    finally:
        guard.close()
    assert set(closed) == {"tls/127.0.0.1:4711"}
    assert len(said) == 2  # that anna went, and what is wrong with the list
    assert "access.yaml" in said[1]


def test_a_connection_that_cannot_be_closed_is_told_once_it_stays(own_certs, monkeypatch):
    monkeypatch.setattr(zenoh_guard, "shut_down", lambda peer: 0)
    links = Links("nobody")
    guard = Guard(links, str(own_certs / "arm"), lambda _: None)
    assert guard._close_strangers() == ""  # it may have gone by itself
    assert "'nobody' at tls/127.0.0.1:4711" in guard._close_strangers()
    links.link.auth_identifier = "qp"
    assert guard._close_strangers() == ""
