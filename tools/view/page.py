"""One page: what it is sent, and what becomes of each word that it says."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.view.access import Visit
from hoap3.tools.view.steering.operator import Operator

WAITING = 512  # words that wait to be sent to a page; of more the oldest are lost
MOST_WRONG = 100  # words of a page that are refused, after which it is cut off
MOST_A_SECOND = 400
AHEAD = 3  # frames that a page is sent and has not drawn yet; a newer one replaces what waits
MOST_AT_ONCE = 8  # things that a page has asked for and that are not done yet; stops apart
OLD_S = 1.5  # since a newer picture was sent, after which what was asked of one counts no longer
LOOKS = {"recover", "change", "acquire"}  # verbs that need to know what is, and say what they saw
LOOKED_BACK = 256  # frames that were sent, some 8 s of them
POLICY = 1008  # why a connection is closed, in the protocol's words: against the rules


class Socket(Protocol):
    """What of a websocket is used."""

    async def send(self, message: str) -> None:
        """Send a text; waits while the other side takes none."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Close it."""


class Player(Protocol):
    """A place in a log, and how fast it moves on."""

    def seek(self, at_s: float) -> None:
        """Go to a time of the log [s]."""

    def play(self, speed: float) -> None:
        """Move on so many times as fast as it was; 0: stay."""


class WrongWordError(Hoap3Error):
    """A page said what is no word of ours."""


class Page:
    """One connection.

    Args:
        socket: to the page.
        visit: what it has proved.
        operator: what may be done to the robot; None where nothing may.
        player: of a log; None of a running robot.

    Attributes:
        wrong: how many of its words were refused.
        dropped: frames that it did not take in time, and never gets.
    """

    def __init__(
        self,
        socket: Socket,
        visit: Visit,
        operator: Operator | None,
        player: Player | None = None,
    ) -> None:
        self._socket, self._visit = socket, visit
        self._operator, self._player = operator, player
        self._frame, self._wake = "", asyncio.Event()
        self._words: deque[str] = deque(maxlen=WAITING)
        self._doing: set[asyncio.Task[None]] = set()
        self._stopping: set[asyncio.Task[None]] = set()
        self._tick: int | None = None  # of the frame that waits
        self._sent: deque[tuple[float, int]] = deque(maxlen=LOOKED_BACK)  # when which tick was
        self._second, self._in_second = 0, 0
        self._frames = 0  # that were sent
        self._drawn: int | None = None  # of these, once it has said so
        self.wrong = self.dropped = 0

    def show(self, frame: str, tick: int | None = None) -> None:
        """Send a frame, a JSON object, when the page takes it; a newer one replaces it."""
        self.dropped += bool(self._frame)
        self._frame, self._tick = frame, tick
        self._wake.set()

    def tell(self, word: str) -> None:
        """Send something that is no frame."""
        self._words.append(word)
        self._wake.set()

    def greet(self, hello: str) -> None:
        """Say what a page must know before the first frame; it shows nothing of before any more.

        Args:
            hello: what all pages must know, a JSON object.
        """
        writes = self._operator is not None
        own = text({"kind": "hello", "version": 1, "nonce": self._visit.nonce, "writes": writes})
        self._frame = ""
        self._sent.clear()
        self.tell(f"{own[:-1]},{hello[1:]}")

    async def send(self) -> None:
        """Send whatever there is, until the connection is closed."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._words:
                await self._socket.send(self._words.popleft())
            if self._drawn is not None and self._frames >= self._drawn + AHEAD:
                continue  # a page that draws slowly would fall behind more and more
            frame, self._frame = self._frame, ""
            if frame:
                self._frames += 1
                if self._tick is not None:
                    self._sent.append((time.monotonic(), self._tick))
                own: dict[str, Any] = {"operator": "none", "asked": {}}
                if self._operator is not None:
                    own = {"operator": self._operator.says(self), "asked": self._operator.asked}
                await self._socket.send(f"{frame[:-1]},{text(own)[1:]}")

    async def receive(self, message: str | bytes) -> None:
        """Take one word of the page."""
        number: object = None
        try:
            word = _parsed(message)
            number = word.get("id")
            self._count()
            self._take(word)
        except Hoap3Error as error:
            await self._refuse(number, str(error))
        except Exception as error:  # noqa: BLE001 - a page has to be able to stop the robot
            await self._refuse(number, f"{type(error).__name__}: {error}")

    def leave(self) -> None:
        """The connection is closed; stops that it asked for are asked for all the same."""
        for task in self._doing:
            task.cancel()
        if self._operator is not None:
            self._operator.left(self)

    def _take(self, word: Mapping[str, Any]) -> None:
        match word.get("kind"):
            case "prove":
                ok = self._visit.prove(_text(word, "proof"))
                self.tell(text({"kind": "proved", "ok": ok}))
                if not ok:
                    raise WrongWordError("that is not the proof of the token")
            case "beat":
                self._accept(word, "beat")
                if self._operator is not None:
                    self._operator.beat(self)
            case "drawn":
                self._drawn = int(_number(word, "frames"))
                self._wake.set()
            case "act":
                do = _text(word, "do")
                self._accept(word, do)
                self._act(word["id"], _parsed(do))
            case "seek" if self._player is not None:
                self._player.seek(_number(word, "at_s"))
            case "play" if self._player is not None:
                self._player.play(_number(word, "speed"))
            case kind:
                raise WrongWordError(f"no word is called {kind!r:.40}")

    def _accept(self, word: Mapping[str, Any], what: str) -> None:
        why = self._visit.accept(word.get("id"), what, _text(word, "mac"))
        if why:
            raise WrongWordError(why)

    def _act(self, number: int, do: Mapping[str, Any]) -> None:
        """Begin to do it; what asks nobody else is done in its turn, and at once."""
        if self._operator is None:
            raise WrongWordError("nobody may write here")
        _text(do, "verb")
        if self._operator.move(self, do):
            self.tell(text({"kind": "told", "id": number, "error": None, "now": {}}))
            return
        if do["verb"] in LOOKS and not self._saw(do.get("tick")):
            raise WrongWordError("the page showed an old picture when that was asked: ask again")
        doing = self._stopping if do["verb"] == "stop" else self._doing
        if len(doing) >= MOST_AT_ONCE:
            raise WrongWordError(f"{MOST_AT_ONCE} things that it asked for are not done yet")
        task = asyncio.ensure_future(self._done(number, do, self._operator))
        doing.add(task)
        task.add_done_callback(doing.discard)

    def _saw(self, tick: object) -> bool:
        """Whether a page that shows the frame of a tick shows what is, or what was a moment ago.

        So it is where no newer frame was sent to it, or one only a moment ago. A word that the
        network has kept for long is of a frame that was replaced long ago.
        """
        ticks = [each for _, each in self._sent]
        if tick not in ticks:
            return not ticks and tick is None
        newer = ticks.index(tick) + 1
        return newer == len(ticks) or time.monotonic() - self._sent[newer][0] < OLD_S

    async def _done(self, number: int, do: Mapping[str, Any], operator: Operator) -> None:
        error, now = None, {}
        try:
            now = await operator.act(self, do)
        except Hoap3Error as refusal:
            error = str(refusal)
        except Exception as failure:  # noqa: BLE001 - whoever asked has to know
            error = f"{type(failure).__name__}: {failure}"
        self.tell(text({"kind": "told", "id": number, "error": error, "now": now}))

    async def _refuse(self, number: object, why: str) -> None:
        self.wrong += 1
        told = number if isinstance(number, int) else None
        self.tell(text({"kind": "told", "id": told, "error": why, "now": {}}))
        if self.wrong > MOST_WRONG:
            await self._socket.close(POLICY, "too many words that are refused")

    def _count(self) -> None:
        second = int(time.monotonic())
        self._in_second = self._in_second + 1 if second == self._second else 1
        self._second = second
        if self._in_second > MOST_A_SECOND:
            self.wrong = MOST_WRONG
            raise WrongWordError(f"more than {MOST_A_SECOND} words in a second")


def text(content: Mapping[str, Any]) -> str:
    """As JSON, without blanks; null for numbers that are not finite, which JSON has none of."""
    try:
        return json.dumps(content, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(content), separators=(",", ":"), allow_nan=False)


def _finite(content: Any) -> Any:
    """The same, with None for each number that is not finite."""
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _parsed(message: str | bytes) -> Mapping[str, Any]:
    """A JSON object.

    Raises:
        WrongWordError: it is none.
    """
    if isinstance(message, bytes):
        raise WrongWordError("words are text, not bytes")
    try:
        found = json.loads(message)
    except (ValueError, RecursionError) as error:
        raise WrongWordError(f"that is not JSON ({error!s:.60})") from error
    if not isinstance(found, dict):
        raise WrongWordError("that is no JSON object")
    return found


def _text(word: Mapping[str, Any], key: str) -> str:
    found = word.get(key)
    if not isinstance(found, str):
        raise WrongWordError(f"{key} must be text")
    return found


def _number(word: Mapping[str, Any], key: str) -> float:
    found = word.get(key)
    if not isinstance(found, int | float) or isinstance(found, bool) or not abs(found) < 1e9:
        raise WrongWordError(f"{key} must be a number")
    return float(found)
