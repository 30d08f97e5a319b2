"""UR5 whose hand a page drags: where it is, who drags it, and when targets are sent."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pinocchio as pin

import hoap3
from hoap3.protocol.link import zenoh_session as network
from hoap3.protocol.messages import FloatArray, State, Target
from hoap3.tools.services.client import client_settings
from hoap3.tools.services.connection import Connection
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    Command,
    followed,
    wait_for_mode,
)
from support.pages.view_bench import PagePen

ROBOT = "ur5"
HOME = [-0.5, -0.15, 0.35]
FAR = [-0.45, 0.25, 0.45]
HOLDER = """
import hashlib, hmac, json, sys, time
from websockets.sync.client import connect
host, token = sys.argv[1:]
code = lambda text: hmac.new(token.encode(), text.encode(), hashlib.sha256).hexdigest()
with connect(f"ws://{host}/socket", origin=f"http://{host}", max_size=None) as socket:
    nonce, number, tick = json.loads(socket.recv())["nonce"], 0, None
    while tick is None:
        tick = json.loads(socket.recv()).get("tick")
    socket.send(json.dumps({"kind": "prove", "proof": code(f"{nonce}http://{host}")}))
    def say(**do):
        global number
        number += 1
        text = json.dumps(do)
        mac = code(f"{nonce}\\n{number}\\n{text}")
        word = {"kind": "act", "id": number, "mac": mac, "do": text}
        socket.send(json.dumps(word))
        while (told := json.loads(socket.recv())).get("id") != number or told["kind"] != "told":
            pass
        assert told["error"] is None, told
    say(verb="acquire", tick=tick)
    say(verb="target", name="hand", values=json.loads(sys.stdin.readline()))
    while True:
        number += 1
        mac = code(f"{nonce}\\n{number}\\nbeat")
        socket.send(json.dumps({"kind": "beat", "id": number, "mac": mac}))
        print("steers", flush=True)
        time.sleep(0.05)
"""


def address(command: Command) -> tuple[str, str]:
    """Host and token that it has printed."""
    for _ in range(3000):
        found = re.search(r"http://(\S+)/#(\S+)", command.stdout)
        if found:
            return found[1], found[2]
        assert not command.ended_within(0.02), command.stderr
    raise AssertionError("it printed no address")


@contextmanager
def viewed_arm(
    at: str, law: Sequence[object] = QUIET, robot: Sequence[object] = PATIENT
) -> Iterator[tuple[Command, Command]]:
    """UR5 that follows `steered_ur5`: its controller, and the command that shows it.

    Args:
        at: where the robot listens.
        law, robot: more words of the commands of each.
    """
    with followed(at, (ROBOT, "steered_ur5"), robot=(*QUIET, *robot), law=law) as (_, command):
        wait_for_mode("active", at, ROBOT)
        with Command("view", ROBOT, "--connect", at, "--port", "0") as viewer:
            yield command, viewer


def tool(q: np.ndarray) -> np.ndarray:
    """Pose of the arm's tool, (4, 4)."""
    return pose(hoap3.load_robot(ROBOT), "tool0", q)


def pose(robot: hoap3.RobotDescription, link: str, q: np.ndarray) -> np.ndarray:
    """Pose of a link in the base frame by plain Pinocchio, (4, 4)."""
    model = pin.buildModelFromXML(robot.urdf)
    data, ours = model.createData(), np.zeros(model.nq)
    for name, angle in zip(robot.joint_names, q, strict=True):
        ours[model.joints[model.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(model, data, ours)
    base, there = (
        data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (robot.base_frame, link)
    )
    return base.actInv(there).homogeneous


def hand(state: State) -> np.ndarray:
    return tool(state.reference)[:3, 3]


def steer(pen: PagePen) -> None:
    """Prove the token, and become operator, as soon as nobody else is."""
    assert pen.hello["writes"]
    if not pen.prove():
        raise AssertionError("the token is wrong")
    for _ in range(600):
        told = pen.act(verb="acquire")
        if told["error"] is None:
            return
        pen.wait_for("frame")
    raise AssertionError(told)


def goes_to(robot: Connection, pen: PagePen, aim: list[float]) -> None:
    """Drag the hand somewhere, again and again as a page does, until it is there.

    On a busy machine a page may be silent for so long that it is held, or loses the lease.
    """
    until = time.monotonic() + PATIENCE_S
    while np.linalg.norm(hand(state := robot.state()) - aim) >= 1e-3:
        assert time.monotonic() < until, (hand(state), state.mode, pen.events)
        if pen.act(verb="target", name="hand", values=aim)["error"] is not None:
            steer(pen)
        pen.wait_for("frame")


@contextmanager
def dragging(host: str, token: str, aim: list[float]) -> Iterator[subprocess.Popen[str]]:
    """A page in a process of its own, which drags and lives."""
    words = [sys.executable, "-c", HOLDER, host, token]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            print(json.dumps(aim), file=process.stdin, flush=True)
            for _ in range(10):  # half a second: it moves
                assert process.stdout.readline() == "steers\n"
            yield process
        finally:
            process.kill()


def until_rest(robot: Connection, since: State) -> tuple[float, np.ndarray]:
    """When the reference's speed last exceeded 2 mm/s [s since then], and where the hand is."""
    last, before = since.tick, since
    for state in robot.states():
        fast = np.linalg.norm(hand(state) - hand(before)) / (state.tick - before.tick) > 2e-6
        last, before = (state.tick if fast else last), state
        if state.tick > max(last, since.tick + 200) + 300:
            return (last - since.tick) * 1e-3, hand(state)
    raise AssertionError


class Targets:
    """All targets that anybody sends, as they come: when [ns], and their numbers."""

    def __init__(self, at: str) -> None:
        self._session = network.open_session(client_settings(at))
        self._news = threading.Condition()
        self.sent: list[tuple[int, FloatArray]] = []
        self._heard = self._session.declare_subscriber(network.key(ROBOT, "targets/*"), self._take)

    def __enter__(self) -> Targets:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def wait_for(self, count: int) -> bool:
        """Wait until so many have been sent; whether they have."""
        with self._news:
            return self._news.wait_for(lambda: len(self.sent) >= count, PATIENCE_S)

    def _take(self, sample: Any) -> None:
        target = Target.like(payload := bytes(sample.payload))
        target.load(payload)
        with self._news:
            self.sent.append((time.monotonic_ns(), target.values.copy()))
            self._news.notify_all()
