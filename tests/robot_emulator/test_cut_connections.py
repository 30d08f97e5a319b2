"""A robot over HOAP-3's protocol whose client is cut off at any byte of an exchange."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.hoap3_tcp.robot_link import Hoap3RobotLink
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.protocol.stop_reasons import STOP_REASONS
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import build_loop

PATIENCE_S = 30.0
HOAP3 = load("hoap3")
LOST = Event.schema.constants["REASON_HOLDER_LOST"]
KINDS = [
    ("paper", 21),
    ("paper", 22),
    pytest.param("legacy", 21, marks=pytest.mark.slow),
    pytest.param("legacy", 22, marks=pytest.mark.slow),
]


def until(holds) -> None:
    """Wait for what the robot does."""
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.001)


@contextmanager
def served(settings: Hoap3TcpSettings) -> Iterator[tuple[RobotLoop, Hoap3RobotLink]]:
    """A robot that runs in lockstep, and its link."""
    ended, clock = threading.Event(), VirtualClock()
    inner = Hoap3RobotLink(HOAP3, settings, lambda _: None, blocking=True)
    link = RemoteLockstepLink(inner, clock, 200_000, ended.is_set, endless=True)
    with closing(link):
        robot = build_loop(EmulatorConfig(), HOAP3, clock, link, NoRecorder(), lockstep=True)
        thread = threading.Thread(target=robot.run, args=(0, ended.is_set), daemon=True)
        thread.start()
        yield robot, inner
        ended.set()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@pytest.mark.parametrize(("order", "slots"), KINDS)
def test_it_comes_to_rest_wherever_the_connection_is_cut(order: str, slots: int) -> None:
    """By an end and a reset by turns: a safe stop that lasts until the next recovery."""
    settings = Hoap3TcpSettings(init_port=0, control_port=0, order=order, slots=slots)
    with served(settings) as (robot, inner):
        for sent in range(8 * slots + 1):
            inner._ask("recover", "test")
            cut_off(inner.ports, sent, order, struct.Struct(f"<{slots}d"))
            until(lambda stops=sent + 1: robot.safe_stops == stops)
            until(lambda: robot._state.mode == State.STOPPED)  # published: the tick is over
            assert robot._status()["stop_reason"] == STOP_REASONS[LOST]
            assert not robot.plant.dq.any()


def test_it_stays_at_rest_wherever_the_beginning_is_cut() -> None:
    with served(Hoap3TcpSettings(init_port=0, control_port=0)) as (robot, inner):
        for sent in range(16):
            with socket.create_connection(("127.0.0.1", inner.ports[0])) as first:
                first.sendall(struct.pack("<2d", 1, 100)[:sent])
                if sent % 2:
                    reset_at_close(first)
            until(lambda refused=sent + 1: inner.counts()["refused"] == refused)
        assert robot.mode == State.IDLE
        assert robot.safe_stops == 0
        cut_off(inner.ports, 0, "paper", struct.Struct("<21d"))
        until(lambda: robot.safe_stops == 1)


def reset_at_close(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def cut_off(ports: tuple[int, ...], sent: int, order: str, frame: struct.Struct) -> None:
    """Drive joint 0 for some exchanges, to and fro by turns, and go after a part of a frame."""
    with socket.create_connection(("127.0.0.1", ports[0])) as first:
        first.sendall(struct.pack("<2d", 1, 100))
        client = socket.create_connection(("127.0.0.1", ports[1]))
    with client:
        client.settimeout(PATIENCE_S)
        if order == "legacy":
            client.sendall(bytes(frame.size))
        for _ in range(5):
            counts = frame.unpack(client.recv(frame.size, socket.MSG_WAITALL))
            client.sendall(frame.pack(counts[0] + (10 if sent % 2 else -10), *counts[1:]))
        client.recv(frame.size, socket.MSG_WAITALL)
        client.sendall(frame.pack(*counts)[:sent])
        if sent // 2 % 2:
            reset_at_close(client)
