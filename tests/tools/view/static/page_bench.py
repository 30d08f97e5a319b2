"""A server that speaks the page's language, and makes its frames up."""

from __future__ import annotations

import hashlib
import hmac
import json
import math
import mimetypes
import secrets
import struct
import threading
import time
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from typing import Any

import numpy as np
from support import HOUSE
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Response
from websockets.sync.server import serve

STATIC = HOUSE / "tools" / "view" / "static"
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
POLICY += "connect-src 'self'; worker-src 'self'"
TOKEN = "a-token-of-tests"
GREY, BLUE = [0.75, 0.77, 0.8, 1.0], [0.3, 0.45, 0.7, 1.0]
HERE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
TETRAHEDRON = struct.pack("<II", 4, 4) + (
    np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], "<f4").tobytes()
    + np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], "<u4").tobytes()
)


def code(text: str, key: str = TOKEN) -> str:
    """What Python's hmac makes of a text and the token, or another key."""
    return hmac.new(key.encode(), text.encode(), hashlib.sha256).hexdigest()


def visual(shape: str, size: list[float], z: float = 0.0, color: Any = GREY) -> dict[str, Any]:
    """One shape, moved along z."""
    origin = [0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0]
    return {"shape": shape, "size": size, "origin": origin, "color": color}


LINKS = [
    {"name": "base", "visuals": [visual("cylinder", [0.09, 0.1], 0.05, BLUE)]},
    {"name": "arm", "visuals": [visual("box", [0.07, 0.07, 0.3], 0.15)]},
    {"name": "wrist", "visuals": [visual("capsule", [0.03, 0.16], 0.08, BLUE)]},
    {
        "name": "tool",
        "visuals": [
            visual("sphere", [0.04]),
            {**visual("mesh", [1.0, 1.0, 1.0]), "mesh": "/mesh/tetrahedron"},
        ],
    },
]
PLOTS = [
    {"key": "error", "label": "|e| = √(2V)", "unit": "m", "group": "error"},
    {"key": "v", "label": "V", "unit": "", "group": "V", "log": True},
    {"key": "must", "label": "dV/dt at most", "unit": "1/s", "group": "V rate", "dashed": True},
    {"key": "is", "label": "dV/dt of the command", "unit": "1/s", "group": "V rate"},
    {"key": "margin", "label": "smallest margin", "unit": "", "group": "margin"},
]


def joint(name: str, lower: float | None, upper: float | None) -> dict[str, Any]:
    """A revolute joint of the robot."""
    limits = {"lower": lower, "upper": upper, "velocity": 2.0, "effort": 9.0}
    return {"name": name, **limits, "unit": "rad"}


def hello(**more: Any) -> dict[str, Any]:
    """What the page learns first."""
    return {
        "kind": "hello",
        "version": 1,
        "robot": "made up",
        "live": True,
        "writes": True,
        "period_s": 0.001,
        "links": LINKS,
        "log": None,
        "joints": [
            joint("turn", -1.5, 1.5),
            joint("lift", -0.2, 1.8),
            joint("roll", None, None),
        ],
        "soles": [{"link": "base", "polygon": [[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0]]}],
        "targets": [
            {"name": "hand", "kind": "frame_pose", "frame": "tool", "reference": None},
            {"name": "aside", "kind": "frame_position", "frame": "tool", "reference": "base"},
            {"name": "push", "kind": "wrench", "frame": "tool", "reference": None},
        ],
        "changeable": [
            {"key": "gamma", "label": "γ", "lower": 0.1, "upper": 5.0, "value": 1.0, "unit": "1/s"},
            {"key": "kp", "label": "gain", "lower": None, "upper": None, "value": 20, "unit": ""},
            {"key": "norm", "label": "norm", "lower": None, "upper": None, "value": "L2"},
        ],
        "config": "controller: qp12\nparameters: {gamma: 1.0}\n",
        "plots": PLOTS,
        "constraints": [{**visual("sphere", [0.1], 0.4, [0.84, 0.37, 0, 0.35]), "link": "base"}],
        **more,
    }


def poses(at_s: float) -> list[list[float]]:
    """Of the links, all of them turned and away from where they began."""
    found = []
    for i in range(len(LINKS)):
        half = 0.5 * (0.2 * i + 0.3 * math.sin(at_s + i))
        axis = np.array([[0, 0, 1], [0, 1, 0], [0.6, 0.8, 0], [1, 0, 0]][i]) * math.sin(half)
        found.append([0.1 * i * math.cos(at_s), 0.02 * i, 0.25 * i, *axis, math.cos(half)])
    return [[float(each) for each in pose] for pose in found]


def frame(tick: int, **more: Any) -> dict[str, Any]:
    """One of the frames that are made up."""
    at_s = tick / 1000
    where = poses(at_s)
    return {
        "kind": "frame",
        "tick": tick,
        "time_s": at_s,
        "stamp_ns": time.time_ns(),
        "mode": "active",
        "stop_reason": None,
        "holder": "qp12-4711",
        "poses": where,
        "q": [math.sin(at_s), 1.79, 2 * at_s],
        "dq": [math.cos(at_s), 0.0, 0.2],
        "tau": [1.0, -2.0, 0.5],
        "com": [0.05, 0.02, 0.35],
        "zmp": [0.04, 0.03],
        "polygon": [[-0.1, -0.1], [0.15, -0.1], [0.15, 0.12], [-0.1, 0.12]],
        "contacts": [{"at": [0.1, 0.1, 0.0], "force": [0.0, 3.0, 20.0]}],
        "frames": [{"name": "hand", "pose": where[3]}],
        "targets": [where[3], [0.3, 0.1, 0.5], [0.0] * 6],
        "values": {
            "error": 0.1 * math.exp(-at_s / 5),
            "v": 0.01 * math.exp(-at_s / 2),
            "must": -0.5 * math.exp(-at_s / 3),
            "is": -0.6 * math.exp(-at_s / 3),
            "margin": None,
        },
        "verdicts": {
            "deadlines": {"verdict": "pass", "words": ""},
            "task": {"verdict": "fail", "words": "error above tolerance at the end"},
        },
        **more,
    }


class MadeUpView:
    """What one test serves, and what its page has sent.

    Args:
        hello: see the function of that name.
        frames: makes the frame of a tick; None: none are sent but those that `say` sends.
    """

    def __init__(self, hello: dict[str, Any], frames: Any = frame) -> None:
        self._hello, self._frames = hello, frames
        self.taken: list[dict[str, Any]] = []  # whatever came, in its order
        self.asked: list[tuple[float, dict[str, Any]]] = []  # when, and what `do` says
        self.operator, self.error = "none", None
        self.flowing = True
        self.wrong: list[str] = []  # codes and numbers that a server would refuse
        self._closed = threading.Event()
        self._sockets: list[Any] = []
        self._server = serve(
            self._talk, "127.0.0.1", 0, process_request=self._static, compression=None
        )
        self.origin = f"http://127.0.0.1:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        for socket in self._sockets:
            socket.close()
        self._server.shutdown()
        self._thread.join(10)

    def address(self, token: str = TOKEN) -> str:
        return f"{self.origin}/#{token}" if token else f"{self.origin}/"

    def say(self, message: dict[str, Any]) -> None:
        """To all pages."""
        for socket in self._sockets:
            socket.send(json.dumps(message))

    def cut(self) -> None:
        """The connection, not the server."""
        while self._sockets:
            self._sockets.pop().close()

    def verbs(self) -> list[str]:
        return [do["verb"] for _, do in self.asked]

    def wait(self, seconds: float) -> None:
        """While the browser is busy, so that no question to it helps."""
        self._closed.wait(seconds)

    def heard(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.taken if message["kind"] == kind]

    def _static(self, connection: Any, request: Any) -> Any:
        if request.path == "/socket":
            return None
        name = request.path.partition("?")[0].removeprefix("/") or "index.html"
        if name == "mesh/tetrahedron":
            return self._file(TETRAHEDRON, "application/octet-stream")
        if not (STATIC / name).is_file():
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file\n")
        kind = "text/javascript" if name.endswith(".js") else mimetypes.guess_type(name)[0]
        return self._file((STATIC / name).read_bytes(), kind or "application/octet-stream")

    def _file(self, content: bytes, kind: str) -> Any:
        length = str(len(content))
        headers = {
            "Content-Type": kind,
            "Content-Length": length,
            "Content-Security-Policy": POLICY,
        }
        return Response(200, "OK", Headers(headers), content)

    def _talk(self, socket: Any) -> None:
        newest = 0
        self._sockets.append(socket)
        nonce = secrets.token_hex(16)  # of this connection alone
        socket.send(json.dumps({**self._hello, "nonce": nonce}))
        threading.Thread(target=partial(self._stream, socket), daemon=True).start()
        for text in socket:
            message = json.loads(text)
            self.taken.append(message)
            if message["kind"] == "prove":
                ok = message["proof"] == code(nonce + self.origin)
                socket.send(json.dumps({"kind": "proved", "ok": ok}))
            elif message["kind"] in {"act", "beat"}:
                said = message.get("do", "beat")
                if message["mac"] != code(f"{nonce}\n{message['id']}\n{said}"):
                    self.wrong.append(text)
                if message["id"] <= newest:
                    self.wrong.append(f"{message['id']} after {newest}")
                newest = message["id"]
                if message["kind"] == "act":
                    self._act(socket, message["id"], json.loads(said))

    def _act(self, socket: Any, number: int, do: dict[str, Any]) -> None:
        self.asked.append((time.monotonic(), do))
        if do["verb"] in {"acquire", "release"} and self.error is None:
            self.operator = "me" if do["verb"] == "acquire" else "none"
        socket.send(json.dumps({"kind": "told", "id": number, "error": self.error, "now": None}))

    def _stream(self, socket: Any) -> None:
        tick = 0
        while self._frames is not None and not self._closed.wait(0.066):
            tick += 66
            try:
                if self.flowing:
                    socket.send(json.dumps({**self._frames(tick), "operator": self.operator}))
            except ConnectionClosed:
                return


@contextmanager
def made_up_view(**more: Any) -> Any:
    """A server, and no trace of it afterwards."""
    frames = more.pop("frames", frame)
    view = MadeUpView(hello(**more), frames)
    try:
        yield view
    finally:
        view.close()
    assert view.wrong == []
