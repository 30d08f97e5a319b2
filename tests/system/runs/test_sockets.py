"""Whatever runs: nothing listens beyond loopback."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import pytest
from socket_census import addresses, assert_loopback_only, census
from support.command_bench import QUIET, Command, controller, emulator, endpoint

pytestmark = pytest.mark.slow


def test_the_census_sees_what_listens_everywhere() -> None:
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        tcp.bind(("0.0.0.0", 0))
        tcp.listen()
        udp.bind(("127.0.0.1", 0))
        assert addresses(os.getpid()) >= {"0.0.0.0", "127.0.0.1"}


def test_services_and_tools_listen_on_loopback_only(tmp_path: Path) -> None:
    at = endpoint()
    with (
        emulator("hoap3", *QUIET, at=at) as robot,
        controller("qp12", *QUIET, at=at) as law,
        Command("record", "hoap3", "--connect", at, "--out", tmp_path / "log") as record,
    ):
        law.hear("following robot")
        record.hear("recording")
        assert census(robot) == {"127.0.0.1"}
        for client in (law, record):
            assert_loopback_only(census(client))
            assert census(client) == set()  # clients open no port at all
        assert record.end(signal.SIGTERM) == 0
        for words in (("status",), ("stop",), ("recover",), ("list", "--live")):
            with Command(*words, "--connect", at) as tool:
                while not tool.ended_within(0.02):
                    assert_loopback_only(census(tool))
                assert tool.end() in {0, 1}, tool.stderr


@pytest.mark.long
def test_a_run_never_listens_elsewhere_at_any_moment(tmp_path: Path) -> None:
    with Command("run", "--duration", "5", "--out", tmp_path / "log") as run:
        while not run.ended_within(0.02):
            assert_loopback_only(census(run))
