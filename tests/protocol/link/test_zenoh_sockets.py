"""No socket of ours may wait at its end for a peer that froze."""

from __future__ import annotations

import os
import socket
import struct
from contextlib import suppress
from pathlib import Path

import pytest
from loopback import eventually, next_state

from hoap3.protocol.link.zenoh_sockets import forbid_lingering, shut_down

TEN_SECONDS = struct.pack("ii", 1, 10)


def connected() -> list[socket.socket]:
    """Copies of the connected TCP sockets of this process."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            if os.readlink(Path("/proc/self/fd") / name).startswith("socket:"):
                one = socket.socket(fileno=os.dup(int(name)))
                one.getpeername()
                found += [one] if one.family == socket.AF_INET else []
    return found


def lingers(one: socket.socket) -> bool:
    option = one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
    return bool(struct.unpack("ii", option)[0])


def test_neither_side_of_a_link_lingers(network):
    robot, controller = network.pair()
    robot.publish(b"state")
    next_state(controller)
    assert len(connected()) >= 2
    eventually(lambda: not any(map(lingers, connected())), "that no socket lingers")


def test_only_tcp_sockets_that_linger_are_touched():
    left, right = socket.socketpair()
    with left, right, socket.socket() as patient, socket.socket() as impatient:
        for one in (left, patient):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, TEN_SECONDS)
        assert forbid_lingering() == 1
        assert not lingers(patient)
        assert not lingers(impatient)
        assert lingers(left)
        patient.getsockname()  # still open


def test_without_proc_nothing_happens(monkeypatch, tmp_path):
    monkeypatch.setattr("hoap3.protocol.link.zenoh_sockets._SOCKETS", tmp_path / "none")
    assert forbid_lingering() == 0


@pytest.mark.parametrize("mapped", [False, True])
def test_a_client_of_ipv4_is_shut_down_at_a_socket_of_both(mapped):
    host = "[::ffff:127.0.0.1]" if mapped else "127.0.0.1"
    with (
        socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True) as server,
        socket.create_connection(("127.0.0.1", server.getsockname()[1])) as client,
        server.accept()[0],
    ):
        port = client.getsockname()[1]
        assert shut_down(f"tls/{host}:{port + 1 if port < 65535 else 1}") == 0
        assert shut_down(f"tls/{host}:{port}") == 1
        assert client.recv(1) == b""
