"""The server of the live page: files by HTTP, frames and words by a websocket for each page."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import Any, Protocol

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from hoap3.protocol.config.endpoints import zone_fault
from hoap3.protocol.errors import ConfigError, PortInUseError
from hoap3.tools.analysis.event_words import page_warning
from hoap3.tools.analysis.output import bad_connections
from hoap3.tools.view.access import Gate
from hoap3.tools.view.files import MESH, headers, read_static
from hoap3.tools.view.page import Page, Player, text
from hoap3.tools.view.steering.operator import Operator

RATE_HZ = 30.0  # frames a second at most
IDLE_S = 0.1  # between two looks whether somebody has come
PAGES = 16  # at once
NEW_A_SECOND = 2 * PAGES  # pages that come
MOST_FAILED = 64  # different failures that pages are told of
MESSAGE_BYTES = 16 << 10  # of a page, at most
SEND_BYTES = 64 << 10  # on their way to a page that takes them slowly: a few frames
PATH = "/socket"


class Source(Protocol):
    """What a page shows: a running robot, or a log."""

    live: bool
    watched: bool
    version: int

    @property
    def edition(self) -> object:
        """What `hello` was made of: as long as it is the same, so is `hello`."""

    @property
    def meshes(self) -> Mapping[str, bytes]:
        """By digest."""

    def hello(self) -> dict[str, Any]:
        """What a page must know before the first frame."""

    def frame(self) -> dict[str, Any] | None:
        """The newest frame that all pages see; None where there is none."""

    def events(self) -> list[dict[str, Any]]:
        """What happened since the last call."""

    def changeable(self) -> list[dict[str, Any]]:
        """What can be changed, as it is now."""

    def player(self) -> Any:
        """A place in a log for one page, with `frame`; None of a running robot."""


class PageServer:
    """Serves pages of one source.

    Args:
        source: what they show.
        operator: what they may do; None: nothing.
        token: that whoever writes must know; None: nobody may.
        host, port: where to listen; port 0: any that is free.

    Attributes:
        port: where it listens, once it does.
    """

    def __init__(
        self, source: Source, operator: Operator | None, token: str | None, host: str, port: int
    ) -> None:
        self._source, self._operator, self._token = source, operator, token
        self._host, self.port = host.strip("[]"), port
        self._gate = Gate(token, self._host, port)
        self._static = read_static()
        self._pages: dict[Page, Any] = {}
        self._changeable: list[dict[str, Any]] = []
        self._hello: tuple[object, str] | None = None
        self._version = source.version  # that all pages know
        self._failed: set[str] = set()
        self._second, self._in_second = 0, 0
        self._ready = asyncio.Event()

    @property
    def url(self) -> str:
        """What to open in a browser."""
        name = socket.gethostname() if self._host in {"0.0.0.0", "::", ""} else self._host  # noqa: S104
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.port}/" + (f"#{self._token}" if self._token else "")

    def tell_all(self, event: Mapping[str, Any]) -> None:
        """Send all pages an event."""
        word = text(event)
        for page in self._pages:
            page.tell(word)

    async def run(self, stop: asyncio.Event, ready: Callable[[str], None]) -> None:
        """Serve until told to stop.

        Args:
            stop: set when it shall end.
            ready: is told the address.

        Raises:
            PortInUseError: somebody listens there.
            ConfigError: no address of this machine.
        """
        async with await self._listen() as server:
            self.port = server.sockets[0].getsockname()[1]
            self._gate = Gate(self._token, self._host, self.port)
            tasks = [asyncio.create_task(self._show())]
            if self._operator is not None:
                tasks.append(asyncio.create_task(self._operator.run()))
            ready(self.url)
            ending = asyncio.create_task(stop.wait())
            await asyncio.wait({ending, *tasks}, return_when=asyncio.FIRST_COMPLETED)
            failed = [task for task in tasks if task.done()]
            for task in (ending, *tasks):
                task.cancel()
            await asyncio.gather(ending, *tasks, return_exceptions=True)
            for task in failed:
                task.result()

    async def _listen(self) -> Server:
        try:
            return await serve(
                self._visited,
                self._host,
                self.port,
                process_request=self._asked,
                compression=None,
                server_header=None,
                logger=bad_connections("live page"),
                open_timeout=5.0,
                ping_interval=5.0,
                ping_timeout=10.0,
                close_timeout=1.0,
                max_size=MESSAGE_BYTES,
                max_queue=32,
                write_limit=SEND_BYTES,
            )
        except OSError as error:
            if fault := zone_fault(self._host):
                raise ConfigError("--host", "", self._host, *fault) from error
            where = f"{self._host}:{self.port}"
            if isinstance(error, socket.gaierror) or "assign" in str(error):
                remedy = "Name an address of this machine with --host, such as 127.0.0.1"
                raise ConfigError("--host", "", self._host, "is none of here", remedy) from error
            raise PortInUseError(
                f"{where} is in use, or may not be used ({error.strerror}). Choose another port "
                "with --port; 0 takes any that is free"
            ) from error

    def _asked(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; None lets a websocket through."""
        del connection
        host, origin = _only(request.headers, "Host"), _only(request.headers, "Origin")
        if host is None or not self._gate.knows_host(host):
            remedy = "open it by its address, as `hoap3 view` printed it"
            return _refusal(HTTPStatus.FORBIDDEN, remedy)
        if request.path == PATH:
            if not self._gate.knows_origin(origin, host):
                return _refusal(HTTPStatus.FORBIDDEN, "that page is not from here")
            if len(self._pages) >= PAGES:
                return _refusal(HTTPStatus.SERVICE_UNAVAILABLE, f"{PAGES} pages are open already")
            if not self._may_come():
                return _refusal(HTTPStatus.TOO_MANY_REQUESTS, "too many pages in a second")
            return None
        found = self._static.get(request.path)
        mesh = MESH.fullmatch(request.path)
        if mesh is not None and mesh[1] in self._source.meshes:
            found = self._source.meshes[mesh[1]], "application/octet-stream"
        if found is None:
            return _refusal(HTTPStatus.NOT_FOUND, "there is no such file")
        content, kind = found
        given = Headers(headers(host, kind, len(content)))
        return Response(HTTPStatus.OK, HTTPStatus.OK.phrase, given, content)

    def _may_come(self) -> bool:
        """Count one more page that comes; whether it is not one of too many in this second."""
        second = int(time.monotonic())
        self._in_second = self._in_second + 1 if second == self._second else 1
        self._second = second
        return self._in_second <= NEW_A_SECOND

    async def _visited(self, connection: ServerConnection) -> None:
        """Serve one page, until it goes."""
        if len(self._pages) >= PAGES or connection.request is None:
            return
        raw = connection.transport.get_extra_info("socket")
        with suppress(OSError):
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
        origin = _only(connection.request.headers, "Origin") or ""
        player: Player | None = self._source.player()
        page = Page(connection, self._gate.visit(origin), self._operator, player)
        page.greet(self._greeting())
        self._pages[page] = player
        sending = asyncio.create_task(page.send())
        try:
            async for message in connection:
                await page.receive(message)
        except ConnectionClosed:
            pass  # however it went
        finally:
            self._pages.pop(page, None)
            page.leave()
            sending.cancel()
            with suppress(asyncio.CancelledError, ConnectionClosed):
                await sending

    async def _show(self) -> None:
        """Show frames, at most so many a second, while somebody looks."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            self._source.watched = bool(self._pages)
            if not self._pages:
                await asyncio.sleep(IDLE_S)
                due = loop.time()
                self._survive(self._source.events)  # nobody sees them
                continue
            due = max(due + 1.0 / RATE_HZ, loop.time())
            await asyncio.sleep(due - loop.time())
            if self._source.version != self._version:
                self._survive(self._greet_all)
            self._survive(self._tell_news)
            self._survive(self._show_common)
            for page, player in list(self._pages.items()):
                if player is not None:
                    self._survive(partial(_show_own, page, player))

    def _survive(self, what: Callable[[], object]) -> None:
        """Do it; where it fails, whatever the reason, pages are told once, and the rest goes on."""
        try:
            what()
        except Exception as error:  # noqa: BLE001 - pages have to be able to stop the robot
            label = f"not all is shown: {type(error).__name__}: {error}"
            if label not in self._failed and len(self._failed) < MOST_FAILED:
                self._failed.add(label)
                self.tell_all(page_warning(label))

    def _greeting(self) -> str:
        """What all pages must know before the first frame, JSON; made once for all that ask."""
        edition = self._source.edition
        if self._hello is None or self._hello[0] != edition:
            self._hello = edition, text(self._source.hello())
        return self._hello[1]

    def _greet_all(self) -> None:
        version, greeting = self._source.version, self._greeting()
        for page in self._pages:
            page.greet(greeting)
        self._version = version

    def _tell_news(self) -> None:
        for event in self._source.events():
            self.tell_all(event)
        changeable = self._source.changeable()
        if changeable != self._changeable:
            self._changeable = changeable
            self.tell_all({"kind": "changed", "changeable": changeable})

    def _show_common(self) -> None:
        frame = self._source.frame()
        if frame is not None:
            shown, tick = text(frame), frame["tick"]
            for page in self._pages:
                page.show(shown, tick)


def _show_own(page: Page, player: Any) -> None:
    frame = player.frame()
    if frame is not None:
        page.show(text(frame))


def _only(found: Headers, name: str) -> str | None:
    """A header that is there once."""
    values = found.get_all(name)
    return values[0] if len(values) == 1 else None


def _refusal(status: HTTPStatus, why: str) -> Response:
    content = f"{why}\n".encode()
    given = {
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Length": str(len(content)),
        "Connection": "close",
    }
    return Response(status, status.phrase, Headers(given), content)
