"""A robot over HOAP-3's protocol whose client is cut off at any byte of an exchange."""

from __future__ import annotations

import socket
import struct
import threading
import time
from contextlib import closing

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.hoap3_robot_link import Hoap3RobotLink
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import build_loop

PATIENCE_S = 30.0
HOAP3 = load("hoap3")
FRAME = struct.Struct("<21d")


def until(holds) -> None:
    """Wait for what the robot does."""
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.001)


def test_it_comes_to_rest_wherever_the_connection_is_cut() -> None:
    ended, clock = threading.Event(), VirtualClock()
    settings = Hoap3TcpSettings(init_port=0, control_port=0)
    inner = Hoap3RobotLink(HOAP3, settings, lambda _: None, blocking=True)
    link = RemoteLockstepLink(inner, clock, 200_000, ended.is_set, endless=True)
    with closing(link):
        robot = build_loop(EmulatorConfig(), HOAP3, clock, link, NoRecorder(), lockstep=True)
        thread = threading.Thread(target=robot.run, args=(0, ended.is_set), daemon=True)
        thread.start()
        for sent in range(FRAME.size + 1):
            inner._ask("recover", "test")
            cut_off(inner.ports, sent)
            until(lambda stops=sent + 1: robot.safe_stops == stops)
            until(lambda: robot.mode == State.STOPPED)
            assert not robot._plant.dq.any()
        ended.set()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def cut_off(ports: tuple[int, int], sent: int) -> None:
    """Drive joint 0 for some exchanges, to and fro by turns, and go after a part of a frame."""
    with socket.create_connection(("127.0.0.1", ports[0])) as first:
        first.sendall(struct.pack("<2d", 1, 100))
        client = socket.create_connection(("127.0.0.1", ports[1]))
    with client:
        client.settimeout(PATIENCE_S)
        for _ in range(5):
            counts = FRAME.unpack(client.recv(FRAME.size, socket.MSG_WAITALL))
            client.sendall(FRAME.pack(counts[0] + (10 if sent % 2 else -10), *counts[1:]))
        client.recv(FRAME.size, socket.MSG_WAITALL)
        client.sendall(FRAME.pack(*counts)[:sent])
