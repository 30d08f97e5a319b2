"""A server of the live page on a free port, with a source of the test's own, and a page."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

from hoap3.protocol.errors import UsageError
from hoap3.tools.view.page import LOOKS
from hoap3.tools.view.server import PageServer

PATIENCE_S = 60.0


class StillSource:
    """A source with one frame, which is new each time that it is asked."""

    live = True

    def __init__(self) -> None:
        self.watched, self.version = False, 1
        self.greeted = 0
        self.meshes: dict[str, bytes] = {}
        self.tick = 0
        self.said: list[dict[str, Any]] = []
        self.greeting: dict[str, Any] = {"robot": "still"}
        self.padding, self.extra = "", dict[str, Any]()

    @property
    def edition(self) -> object:
        return self.version

    def hello(self) -> dict[str, Any]:
        self.greeted += 1
        return self.greeting

    def frame(self) -> dict[str, Any] | None:
        self.tick += 1
        return {"kind": "frame", "tick": self.tick, "padding": self.padding, **self.extra}

    def events(self) -> list[dict[str, Any]]:
        said, self.said = self.said, []
        return said

    def changeable(self) -> list[dict[str, Any]]:
        return []

    def player(self) -> None:
        return None


class NotingOperator:
    """Notes what pages do."""

    def __init__(self) -> None:
        self.done: list[Any] = []
        self.beats = 0
        self.asked = {"hand": [1.0, 2.0, 3.0]}
        self.gone = threading.Event()

    def says(self, page: object) -> str:
        return "none"

    async def act(self, page: object, do: Mapping[str, Any]) -> dict[str, Any]:
        if do.get("verb") not in {"stop", "recover", "change", "acquire"}:
            raise UsageError("no such verb")
        self.done.append(do)
        return {"done": True}

    def move(self, page: object, do: Mapping[str, Any]) -> bool:
        if do.get("verb") != "target":
            return False
        self.done.append(do)
        return True

    def beat(self, page: object) -> None:
        self.beats += 1

    def left(self, page: object) -> None:
        self.gone.set()

    async def run(self) -> None:
        await asyncio.Event().wait()


class Served:
    """A server that runs in a thread."""

    def __init__(self, source: Any, operator: Any, token: str | None) -> None:
        self.source, self.operator, self.token = source, operator, token
        self.loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.url, self.failed = "", ""

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *_: object) -> None:
        self.loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE_S)
        assert not self.failed, self.failed

    @property
    def host(self) -> str:
        return self.url.removeprefix("http://").partition("/")[0]

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self._stop = asyncio.Event()
        server = PageServer(self.source, self.operator, self.token, "127.0.0.1", 0)
        try:
            self.loop.run_until_complete(server.run(self._stop, self._told))
        except Exception as error:
            self.failed = repr(error)
            raise
        finally:
            self._ready.set()
            self.loop.close()

    def _told(self, url: str) -> None:
        self.url = url
        self._ready.set()


class PagePen:
    """What a page says and hears."""

    def __init__(self, socket: ClientConnection, token: str, origin: str) -> None:
        self.socket, self.token, self.origin = socket, token, origin
        self.events: list[str] = []
        self.tick: int | None = None  # of the newest frame that has come
        self._waits = deque[dict[str, Any]]()  # words that have come, and nobody has heard yet
        self.hello = self.wait_for("hello")
        self.nonce = self.hello["nonce"]
        self.number = 0

    def wait_for(self, kind: str, **wanted: object) -> dict[str, Any]:
        """The next word of that kind, with these values."""
        while True:
            word = self._waits.popleft() if self._waits else self._take(PATIENCE_S)
            if word["kind"] == "event":
                self.events.append(str(word.get("label")))
            if word["kind"] == kind and all(word.get(key) == wanted[key] for key in wanted):
                return word

    def look(self) -> int | None:
        """Take all that has come; tick of the newest frame, or of the first one that comes."""
        with suppress(TimeoutError):
            while True:
                self._waits.append(self._take(0.0))
        while self.tick is None:
            self._waits.append(self._take(PATIENCE_S))
        return self.tick

    def _take(self, timeout_s: float) -> dict[str, Any]:
        word: dict[str, Any] = json.loads(self.socket.recv(timeout_s))
        if word["kind"] == "frame":
            self.tick = word["tick"]
        return word

    def say(self, **word: object) -> None:
        self.socket.send(json.dumps(word))

    def code(self, text: str) -> str:
        return hmac.new(self.token.encode(), text.encode(), hashlib.sha256).hexdigest()

    def prove(self) -> bool:
        self.say(kind="prove", proof=self.code(self.nonce + self.origin))
        return bool(self.wait_for("proved")["ok"])

    def mac(self, number: int, text: str) -> str:
        return self.code(f"{self.nonce}\n{number}\n{text}")

    def send(self, **do: object) -> int:
        """Say what is to be done, as a page says it; the number under which the answer comes."""
        if do["verb"] in LOOKS and "tick" not in do:
            do["tick"] = self.look()
        self.number += 1
        text = json.dumps(do)
        self.say(kind="act", id=self.number, mac=self.mac(self.number, text), do=text)
        return self.number

    def act(self, **do: object) -> dict[str, Any]:
        """The same, and the answer."""
        return self.wait_for("told", id=self.send(**do))

    def beat(self) -> None:
        self.number += 1
        self.say(kind="beat", id=self.number, mac=self.mac(self.number, "beat"))


@contextmanager
def page(host: str, token: str = "", origin: str | None = None, **more: Any) -> Iterator[PagePen]:
    """A page that is open, and takes whatever comes, as browsers do."""
    more = {"max_queue": None, **more}
    mine = f"http://{host}" if origin is None else origin
    with connect(f"ws://{host}/socket", origin=mine, max_size=None, **more) as socket:
        yield PagePen(socket, token, mine)
