"""Whatever runs: nothing listens beyond loopback."""

from __future__ import annotations

import ipaddress
import os
import signal
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_bench import Command, controller, emulator, endpoint

LISTEN = 0x0A
TABLES = ("tcp", "tcp6", "udp", "udp6")
QUIET = ("--set", "log.record=false")


def addresses(pid: int) -> set[str]:
    """Addresses on which a process listens (TCP), or could be sent to (UDP)."""
    handles = {_read(handle.readlink) for handle in _read(Path(f"/proc/{pid}/fd").iterdir) or ()}
    found = set()
    for name in TABLES:
        for row in (_read(Path(f"/proc/{pid}/net/{name}").read_text) or "").splitlines()[1:]:
            fields = row.split()
            listens = name.startswith("udp") or int(fields[3], 16) == LISTEN
            if listens and Path(f"socket:[{fields[9]}]") in handles:
                found.add(_readable(fields[1].split(":")[0]))
    return found


def _read(what: Callable[[], Any]) -> Any:
    """What is found, or None where it is gone meanwhile."""
    try:
        return what()
    except (FileNotFoundError, ProcessLookupError):
        return None


def _readable(text: str) -> str:
    """The kernel's hexadecimal words, each in the byte order of the machine."""
    words = [int(text[at : at + 8], 16) for at in range(0, len(text), 8)]
    return str(ipaddress.ip_address(struct.pack(f"={len(words)}I", *words)))


def census(command: Command) -> set[str]:
    """Where the command and all its descendants listen."""
    found = addresses(command.process.pid)
    for pid in command.family():
        found |= addresses(pid)
    return found


def assert_loopback_only(found: set[str]) -> None:
    assert all(ipaddress.ip_address(address).is_loopback for address in found), found


def test_the_census_sees_what_listens_everywhere() -> None:
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        tcp.bind(("0.0.0.0", 0))
        tcp.listen()
        udp.bind(("127.0.0.1", 0))
        assert addresses(os.getpid()) >= {"0.0.0.0", "127.0.0.1"}


def test_a_run_listens_on_loopback_only(tmp_path: Path) -> None:
    with Command("run", "--duration", "60", "--out", tmp_path / "log") as run:
        run.hear(r"following robot")
        found = census(run)
        assert found == {"127.0.0.1"}
        run.end(signal.SIGTERM)


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
