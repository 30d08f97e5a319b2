"""Stop, status, recover and release over a Unix socket of the robot's own machine."""

from __future__ import annotations

import errno
import json
import os
import socket
import stat
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zenoh
from loopback import PATIENCE_S, Network, eventually

from hoap3.protocol.errors import LinkError
from hoap3.protocol.link import local_control
from hoap3.protocol.link.local_control import LocalControl, LocalRobot, local_robots
from hoap3.protocol.link.zenoh_session import key

ENDPOINTS = ("tcp/127.0.0.1:7447",)


@pytest.fixture(autouse=True)
def runtime(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    return tmp_path


@pytest.fixture
def local() -> Iterator[LocalControl]:
    with closing(LocalControl("arm", ENDPOINTS)) as made:
        yield made


def asked(network: Network, verb: str):
    (robot,) = local_robots()
    return network.start(robot.ask, verb)


def take(local: LocalControl):
    return eventually(lambda: next(local.requests(), None), "the request")


@pytest.mark.parametrize("verb", local_control.VERBS)
def test_a_request_reaches_the_loop_and_its_answer_the_client(local, network, verb):
    answer = asked(network, verb)
    request = take(local)
    assert (request.verb, request.local) == (verb, True)
    request.answer({"mode": "idle"})
    told = {"robot": "arm", "endpoints": list(ENDPOINTS)}
    assert answer.result(PATIENCE_S) == {"mode": "idle", **told}


def test_the_socket_is_its_users_alone_and_goes_with_the_robot(runtime):
    local = LocalControl("arm", ENDPOINTS)
    (path,) = runtime.iterdir()
    assert path == local.path
    assert path.name == f"robot-arm-{os.getpid()}.sock"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [(one.name, one.pid) for one in local_robots()] == [("arm", os.getpid())]
    local.close()
    assert list(runtime.iterdir()) == []
    assert local_robots() == []


def test_another_user_is_refused(local, network, monkeypatch):
    monkeypatch.setattr(local_control, "_user", lambda _: os.geteuid() + 1)
    with pytest.raises(LinkError, match="'arm'"):
        local_robots()[0].ask("stop")
    assert list(local.requests()) == []


@pytest.mark.parametrize(
    "line",
    [b"", b"stop\n", b"[1]\n", b'{"verb": "acquire"}\n', b'{"verb": ["stop"]}\n', b"[" * 70_000],
)
def test_what_is_no_request_is_refused_and_never_reaches_the_loop(local, line):
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(local.path))
        client.sendall(line)
        client.shutdown(socket.SHUT_WR)
        answer = client.makefile().readline()
    assert "error" in json.loads(answer)
    assert list(local.requests()) == []


def test_a_client_that_says_nothing_holds_the_next_one_up_for_a_moment_only(local, network):
    with socket.socket(socket.AF_UNIX) as silent:
        silent.connect(str(local.path))
        answer = asked(network, "stop")
        take(local).answer({"mode": "stopped"})
        assert answer.result(PATIENCE_S)["mode"] == "stopped"


def test_a_client_that_cannot_be_accepted_for_want_of_descriptors_waits(
    local, network, monkeypatch
):
    refused = [OSError(errno.EMFILE, os.strerror(errno.EMFILE))] * 3
    really = socket.socket.accept

    def accept(server):
        if refused:
            raise refused.pop()
        return really(server)

    monkeypatch.setattr(local_control, "ACCEPT_PAUSE_S", 0.0)
    monkeypatch.setattr(socket.socket, "accept", accept)
    for verb in ("status", "stop"):  # the thread waits for the first one already
        answer = asked(network, verb)
        take(local).answer({"mode": "stopped"})
        assert answer.result(PATIENCE_S)["mode"] == "stopped"
    assert not refused


def test_a_robot_whose_loop_does_not_serve_is_an_error(local, monkeypatch):
    monkeypatch.setattr(local_control, "ANSWER_TIMEOUT_S", 0.05)
    with pytest.raises(LinkError, match="'arm'"):
        local_robots()[0].ask("stop")


def test_closing_answers_who_waits(local, network):
    answer = asked(network, "status")
    eventually(lambda: not local._asked.empty(), "the request")
    local.close()
    with pytest.raises(LinkError):
        answer.result(PATIENCE_S)
    assert not local._thread.is_alive()


def test_the_socket_of_a_killed_robot_is_not_believed_and_removed(runtime, local):
    stale = runtime / "robot-arm-1.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(stale))
    assert [one.path for one in local_robots()] == [local.path]
    assert not stale.exists()


def test_a_starting_robot_removes_the_sockets_of_killed_ones(runtime):
    stale = runtime / "robot-leg-1.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(stale))
    LocalControl("arm", ENDPOINTS).close()
    assert list(runtime.iterdir()) == []


def test_other_files_in_the_directory_are_left_alone(runtime, local):
    other = runtime / "robot-arm-x.sock"
    other.write_text("mine")
    assert [one.path for one in local_robots()] == [local.path]
    assert other.exists()


def test_without_a_private_directory_there_is_no_socket(monkeypatch, runtime):
    runtime.chmod(0o755)
    with closing(LocalControl("arm", ENDPOINTS)) as local:
        assert local.path is None
        assert list(local.requests()) == []
    assert local_robots() == []


def test_a_directory_whose_name_is_too_long_for_a_socket_is_none(monkeypatch, tmp_path):
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path / ("x" * 120)))
    with closing(LocalControl("arm", ENDPOINTS)) as local:
        assert local.path is None


@pytest.mark.parametrize("answer", [b"", b"nonsense\n", b"[1]\n", b"\xff\n"])
def test_an_answer_that_makes_no_sense_is_an_error(runtime, answer):
    path = runtime / "robot-arm-1.sock"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()

        def serve() -> None:
            client, _ = server.accept()
            with client:
                client.recv(100)
                client.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(LinkError, match="'arm'"):
            LocalRobot("arm", 1, path).ask("status")
        thread.join()


def test_local_requests_come_before_those_of_the_network(local, network):
    robot, controller = network.pair(blocking=True)
    robot.serve_also(local)
    session = controller._session
    session.get(key("arm", "ask/status/somebody"))
    session.put(key("arm", "setpoint"), b"", congestion_control=zenoh.CongestionControl.BLOCK)
    assert robot.arrival.wait(PATIENCE_S)  # so the query is there, too
    answer = asked(network, "stop")
    eventually(lambda: not local._asked.empty(), "the request")
    first, second = robot.requests()
    assert (first.verb, first.local) == ("stop", True)
    assert (second.verb, second.local) == ("status", False)
    first.answer({})
    answer.result(PATIENCE_S)


def test_until_a_robot_has_started_its_status_is_answered_and_the_rest_refused():
    with closing(LocalControl("arm", ENDPOINTS, {"mode": "starting"})) as local:
        (robot,) = local_robots()
        assert robot.ask("status")["mode"] == "starting"
        with pytest.raises(LinkError, match=r"'arm'.*starting"):
            robot.ask("stop")
        assert list(local.requests()) == []
