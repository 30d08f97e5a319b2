"""What a page may do to a robot: steer, change, stop, recover. Each waits for nobody else.

Questions to a robot may take seconds, so they are asked by threads: one for stops, so that nothing
is ahead of one; one for all others; one that sends targets, of which only the newest count. A link
that is full drops messages, so what holds is sent again until the controller has got it. Stops are
asked for through the session of the source, which is open as long as a page is served.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Lock
from typing import Any, TypeVar

from hoap3.protocol.errors import Hoap3Error, LinkError, UsageError, WireError
from hoap3.tools.analysis.event_words import page_warning
from hoap3.tools.services.connection import Connection
from hoap3.tools.view.sources.live import Live
from hoap3.tools.view.steering.motion import Motion

TICK_S = 0.02  # between two looks at what moves
SETTLE_S = 0.2  # between a hold and a release: targets and questions come on different ways
AGAIN_S = 0.03  # after which a hold that the controller has not got is sent again
HOLD_S = 1.5  # and for how long: within the lease
UNCONFIRMED = -1  # in place of the number of a message
COUNT_S = 1.0  # between two questions what was refused
Told = Callable[[dict[str, Any]], None]
Result = TypeVar("Result")


class Operator:
    """At most one page steers; all that proved the token may stop, recover and change.

    Args:
        source: the robot.
        tell: takes events for all pages.
        connect: makes a connection to the robot.

    Attributes:
        page: that steers, or None.
    """

    def __init__(
        self, source: Live, tell: Told, connect: Callable[[str, str], Connection] = Connection
    ) -> None:
        self._source, self._tell, self._connect = source, tell, connect
        self._motion = Motion(lambda: source.frames, self._state)
        self._connection: Connection | None = None
        self._opening = Lock()
        self._threads = {name: ThreadPoolExecutor(1, name) for name in ("stop", "ask", "send")}
        self._sending: Future[Any] | None = None
        self._counting: Future[dict[str, int]] | None = None
        self._refused: dict[str, int] = {}
        self._count_s = self._release_s = 0.0
        self._sent = False
        self._stops, self._why = 0, ""
        self.page: object | None = None

    @property
    def asked(self) -> dict[str, list[float]]:
        """Numbers of each target that the page has moved, as they were sent last."""
        return self._motion.asked

    def says(self, page: object) -> str:
        """`me`, `other` or `none`: who steers, as a page sees it."""
        if self.page is not None:
            return "me" if self.page is page else "other"
        ours = None if self._connection is None else self._connection.who
        return "none" if self._source.operator in {None, ours} else "other"

    async def act(self, page: object, do: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a page asks for; what it must know then.

        Raises:
            Hoap3Error: it is refused; says why.
        """
        verb = do.get("verb")
        match verb:
            case "stop":
                self._stops += 1
                stopping = self._ask("stop", self._source.stop)
                self._motion.forget_motion()
                try:
                    await asyncio.shield(stopping)  # also where the page goes meanwhile
                except Hoap3Error:
                    self._hold_all()
                    raise
                self._motion.begin(time.monotonic())
                self._source.look_again()
                return {}
            case "recover":
                done = await self._ask("ask", lambda: self._robot().recover())
                self._source.look_again()
                if done.get("recovered") is False:
                    mode = done.get("mode")
                    raise UsageError(f"it is {mode}: only a stopped robot can be recovered")
                self._motion.begin(time.monotonic())
                return {}
            case "change":
                what, over_s = do.get("what"), do.get("over_s")
                if not isinstance(what, dict):
                    raise UsageError("a change needs `what`: keys and their numbers")
                more = {} if over_s is None else {"over_s": over_s}
                await self._ask("ask", lambda: self._robot().change(what, **more))
                self._source.changed(over_s)  # as yet the numbers are what they were
                return {}
            case "acquire":
                return await self._acquire(page)
            case "release":
                self._steers(page)
                await self._release()
                return {}
        raise UsageError(f"no verb is called {verb!r:.40}")

    def move(self, page: object, do: Mapping[str, Any]) -> bool:
        """Handle `target`, `place`, `velocity` and `drop`; return False for other verbs.

        Raises:
            UsageError: it is refused; says why.
        """
        verb, now = do.get("verb"), time.monotonic()
        motion = self._motion
        takes = {"target": motion.drag, "place": motion.place, "velocity": motion.drive}
        if verb != "drop" and verb not in takes:
            return False
        self._steers(page)
        if self._release_s:
            raise UsageError("this page was silent and is about to lose its role: steer again")
        if verb == "drop":
            motion.hold()
        else:
            takes[verb](do.get("name"), do.get("values"), now)
        return True

    def beat(self, page: object) -> None:
        """A page lives."""
        if page is self.page:
            self._motion.beat(time.monotonic())

    def left(self, page: object, why: str = "has gone") -> None:
        """A page has gone or is silent: hold what it moved at once, and soon end its role."""
        if page is self.page:
            self._survive(self._hold_all)
            self._survive(self._flush)
        if page is self.page:  # still
            self._release_s, self._why = time.monotonic() + SETTLE_S, why

    async def run(self) -> None:
        """Look after what moves, until cancelled; then hold it, and steer no longer."""
        try:
            while True:
                await asyncio.sleep(TICK_S)
                self._survive(lambda: self._look(time.monotonic()))
        finally:
            self._survive(self._hold_all)
            self._survive(self._flush)

    def close(self) -> None:
        """Send what is still to be held, steer no longer, and leave the network."""
        until = time.monotonic() + 2.0 * HOLD_S
        while (self._is_sending or self._motion.waits) and time.monotonic() < until:
            with suppress(Exception):  # no page is connected to receive the error
                self._flush()
            time.sleep(TICK_S)
        if self.page is not None:
            time.sleep(SETTLE_S)
        for name, threads in self._threads.items():
            threads.shutdown(wait=True, cancel_futures=name != "stop")
        if self._connection is not None:
            self._connection.close()

    def _look(self, now: float) -> None:
        if self.page is None:
            return
        if self._flush():
            self._count(now)
        if self._motion.is_gone(now) and not self._release_s:
            self.left(self.page, "is silent")
        elif 0.0 < self._release_s < now and not self._is_sending:
            self._give_up(f"the page that steered {self._why}")

    def _hold_all(self) -> None:
        self._motion.hold(placed=True)

    def _survive(self, what: Callable[[], object]) -> None:
        """Do it; where it fails, whatever the reason, nobody steers any more, and it is told."""
        try:
            what()
        except Exception as error:  # noqa: BLE001 - stops are asked for by this process
            self._give_up(f"nobody steers here any more: {type(error).__name__}: {error}")

    def _give_up(self, why: str) -> None:
        """End the role of the page, hold what it moved, and tell all pages."""
        due: dict[str, list[float]] = {}
        with suppress(Exception):  # where nothing is known of the robot any more
            self._hold_all()
            due = self._motion.step(time.monotonic())
        self._free()
        self._threads["send"].submit(self._leave, due)
        self._tell(page_warning(why))

    def _leave(self, due: Mapping[str, list[float]]) -> None:
        """In a thread: send the last holds, then release."""
        if due and self._connection is not None:
            with suppress(Hoap3Error):
                self._hold(self._connection, due, self._stops)
        self._let_go()

    def _flush(self) -> bool:
        """Send what is due, unless the last is still being sent; whether we still steer."""
        sending = self._sending
        if sending is not None:
            if not sending.done():
                return True
            self._sending, error = None, sending.exception()
            if error is not None:
                self._give_up(f"nobody steers here any more: {error}")
                return False
            if sending.result() == UNCONFIRMED:
                self._tell(page_warning("the controller has not confirmed the last target"))
        due = self._motion.step(time.monotonic())
        if due and self._connection is not None:
            self._sent = True
            send = self._threads["send"].submit
            if self._motion.moves:
                self._sending = send(_send, self._connection, due)
            else:
                self._sending = send(self._hold, self._connection, due, self._stops)
        return True

    @property
    def _is_sending(self) -> bool:
        return self._sending is not None and not self._sending.done()

    def _count(self, now: float) -> None:
        """Tell pages what the controller refused, once a second at most."""
        counting = self._counting
        if counting is not None and counting.done():
            self._counting = None
            if counting.exception() is None:
                more = counting.result()
                for reason, count in more.items():
                    if count > self._refused.get(reason, 0):
                        self._tell(page_warning(f"targets refused: {reason.replace('_', ' ')}"))
                self._refused = more
        if self._counting is None and self._sent and now > self._count_s:
            self._count_s, self._sent = now + COUNT_S, False
            self._counting = self._threads["ask"].submit(_refused, self._connection)

    async def _acquire(self, page: object) -> dict[str, Any]:
        if self.page not in {None, page}:
            raise UsageError("another page steers; it is free when that page releases or is closed")
        self.page, self._release_s = page, 0.0  # no other page can, while the controller is asked
        self._motion.begin(time.monotonic())  # and its silence counts from now
        try:
            await self._ask("ask", lambda: self._robot().acquire())
        except BaseException:  # also where the page goes meanwhile, and the controller has agreed
            self._free()
            self._threads["ask"].submit(self._let_go)
            raise
        if self.page is not page:
            raise UsageError("the page has gone meanwhile")
        self._motion.begin(time.monotonic())
        self._refused = {}
        self._source.look_again()
        return {"targets": [target.as_json() for target in self._source.frames.targets]}

    async def _release(self) -> None:
        if self._motion.moves or self._motion.waits or self._is_sending:
            self._motion.hold()  # what was held already, and not sent yet, stays as it is
            while (self._motion.waits or self._is_sending) and self._flush():
                await asyncio.sleep(TICK_S)
            await asyncio.sleep(SETTLE_S)
        self._free()
        await self._ask("ask", self._let_go)
        self._source.look_again()

    def _free(self) -> None:
        self.page, self._release_s = None, 0.0
        self._motion.begin(time.monotonic())

    def _hold(self, robot: Connection, due: Mapping[str, list[float]], stops: int) -> int:
        """In a thread: send until the controller has it, a newer target waits, or a stop.

        Returns:
            the number of the last message; `UNCONFIRMED` where the controller did not get it.
        """
        until = time.monotonic() + HOLD_S
        while time.monotonic() < until:
            if self._stops != stops:
                return 0
            number = _send(robot, due)
            time.sleep(AGAIN_S)
            with suppress(Hoap3Error):  # a query may be lost, too
                if self._motion.waits or robot.counts()["newest"] >= number:
                    return number
        return UNCONFIRMED

    def _let_go(self) -> None:
        """In a thread: release, unless a page has begun to steer meanwhile."""
        if self._connection is not None and self.page is None:
            with suppress(LinkError, UsageError, WireError):
                self._connection.release()

    def _steers(self, page: object) -> None:
        if self.page is not page:
            raise UsageError("this page does not steer: become operator first")

    def _state(self) -> Any:
        newest = self._source.newest()
        return None if newest is None else newest.state

    def _robot(self) -> Connection:
        """In a thread: the connection, opened when it is first needed."""
        with self._opening:
            if self._connection is None:
                self._connection = self._connect(self._source.robot, self._source.endpoint)
                self._connection.checks_limits = False  # the page shows what is refused
            return self._connection

    def _ask(self, thread: str, what: Callable[[], Result]) -> asyncio.Future[Result]:
        return asyncio.wrap_future(self._threads[thread].submit(what))


def _send(robot: Connection, due: Mapping[str, list[float]]) -> int:
    """Send targets; the number of the last message."""
    return [robot.send_target(values, name) for name, values in due.items()][-1]


def _refused(robot: Connection | None) -> dict[str, int]:
    try:
        found = {} if robot is None else robot.counts()["refused"]
    except Hoap3Error:
        return {}
    return {str(reason): int(count) for reason, count in found.items()}
