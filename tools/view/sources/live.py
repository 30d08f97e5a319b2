"""A running robot as a source of frames: a client on the network like any other.

It listens to what is sent to those who look on, some 60 States a second, and asks the robot and its
controller once a second how they are, while somebody looks at all.
"""

from __future__ import annotations

import os
import secrets
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import WIRE_VERSION, Event, Setpoint, State
from hoap3.tools.analysis.event_words import page_event, page_warning
from hoap3.tools.analysis.verdicts import judge_reported, shown
from hoap3.tools.services.client import check_name, client_settings
from hoap3.tools.view.picture.changeable import sliders
from hoap3.tools.view.picture.frame import Frames, finite
from hoap3.tools.view.picture.geometry import looks_of, shipped_robot
from hoap3.tools.view.sources.questions import Answer, Questions

ASK_S = 1.0  # between two questions of how they are
SHOW_S = 10.0  # between two questions of what can be changed: others may have changed it
OVER_S = 0.5  # that a change takes, where nobody says
SKIPS_S = 1.0  # between two words of skipped periods, which on a busy machine are many
OLD_S = 1.0  # without a State for those who look on, after which every State is asked for
KEPT = 8  # States and Setpoints, of which the newest that fit each other are shown
EVENTS = 256
_CONSTANTS = Event.schema.constants

Kept = deque[tuple[int, bytes]]
"""When messages arrived [ns], and they themselves."""


@dataclass(frozen=True)
class Pair:
    """A State and what answers it.

    Attributes:
        state: of the robot.
        setpoint: that answers it; None where none has come.
        took_ns: from the arrival of the one here to that of the other; None where not known.
    """

    state: State
    setpoint: Setpoint | None
    took_ns: int | None

    @property
    def place(self) -> tuple[int, int]:
        """Session and tick."""
        return self.state.session_id, self.state.tick


@dataclass(frozen=True)
class Met:
    """What was learnt of a robot and of its controller, as a whole.

    Attributes:
        frames: made for these.
        about: what the controller tells of itself; empty where it does not.
        who: holder and session before that was learnt; None where the robot did not tell.
    """

    frames: Frames
    about: Answer
    who: tuple[Any, Any] | None


class Live:
    """A running robot.

    Args:
        robot: its name.
        endpoint: where it, or a router, listens.
        folder: of the robot on this machine, for its meshes; None: that of a robot that we know.

    Attributes:
        live: True.
        version: rises where `hello` says something else than before.
        watched: whether somebody looks; nothing is asked otherwise.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint.
        LinkError: it cannot be reached.
        WireError: its answer makes no sense.
    """

    live = True

    def __init__(self, robot: str, endpoint: str, folder: str | None = None) -> None:
        from hoap3.protocol.link import zenoh_session as network

        check_name(robot)
        self.robot, self.endpoint, self._folder = robot, endpoint, folder
        self._network = network
        self._states, self._answers = Kept(maxlen=KEPT), Kept(maxlen=KEPT)
        self._heard: deque[bytes] = deque(maxlen=EVENTS)
        self._every: Any = None
        self._skipped, self._skipped_at_s, self._told_s = 0, 0.0, 0.0
        self._show_s = time.monotonic() + SHOW_S  # when to ask again what can be changed
        self._last = (-1, -1)  # session and tick of the newest frame
        self._status: Answer = {}
        self._tasks: Answer = {}
        self._now: Answer | None = None
        self._closing, self._wanted = threading.Event(), threading.Event()
        self._notes, self._noted = deque[str](), set[str]()
        self.watched, self.version = False, 1
        settings = client_settings(endpoint)
        who = network.session_name(settings, f"view-{os.getpid()}-{secrets.token_hex(3)}")
        self._session = network.open_session(settings, robot)
        self._ask = Questions(self._session, robot, who, endpoint)
        try:
            self._met, self._now = self._meet()
            self._subscribers = self._declare()
        except BaseException:
            self._session.close()
            raise
        self._began = time.monotonic()
        self._asker = threading.Thread(target=self._ask_again, name="ask", daemon=True)
        self._asker.start()

    def close(self) -> None:
        """Leave the network."""
        self._closing.set()
        self._wanted.set()
        self._asker.join(timeout=3.0 * self._network.QUERY_TIMEOUT_S)
        self._session.close()

    @property
    def frames(self) -> Frames:
        """What makes its frames."""
        return self._met.frames

    @property
    def edition(self) -> object:
        """What `hello` is made of."""
        return self.version, self._now

    @property
    def meshes(self) -> Mapping[str, bytes]:
        """Its meshes, by digest."""
        return self._met.frames.looks.meshes

    def hello(self) -> dict[str, Any]:
        """What a page must know before the first frame."""
        fixed = {"live": True, "log": None, "second": False}
        return {**fixed, **self._met.frames.hello(), "changeable": self.changeable()}

    def changeable(self) -> list[dict[str, Any]]:
        """What of the controller can be changed, as it is now."""
        return sliders(self._now, self._met.about.get("numbers"))

    def changed(self, over_s: object) -> None:
        """A change of ours was taken, which takes so long [s]: after it numbers are asked for."""
        self._show_s = time.monotonic() + (over_s if isinstance(over_s, int | float) else OVER_S)

    def player(self) -> None:
        """None: what runs has no other time than now."""

    def stop(self) -> Answer:
        """Have the robot brake, through the session that is open already; see `Questions.stop`."""
        return self._ask.stop()

    def look_again(self) -> None:
        """Ask at once how they are."""
        self._wanted.set()

    @property
    def operator(self) -> str | None:
        """Who steers, as the controller told last."""
        found = self._tasks.get("operator")
        return found if isinstance(found, str) else None

    def newest(self) -> Pair | None:
        """The newest State with its answer, if that has come, or may still come; else the newest.

        Of the two newest States the one before counts, while the newest waits for its answer.
        """
        self._listen_to_all()
        known: dict[int, tuple[int, bytes]] = {}
        for stamp, payload in list(self._answers):
            with suppress(WireError):
                known[Setpoint.scalars(payload, "tick")[0]] = stamp, payload
        pairs = []
        for stamp, payload in list(self._states)[:-3:-1]:
            pair = self._paired(stamp, payload, known)
            if pair is not None:
                pairs.append(pair)
        if not pairs:
            return None
        waits = pairs[0].setpoint is None and pairs[0].state.mode == State.ACTIVE
        if waits and len(pairs) > 1 and pairs[1].setpoint is not None:
            return pairs[1]
        return pairs[0]

    def frame(self) -> dict[str, Any] | None:
        """The newest frame; None where nothing has come since the last one."""
        met, newest = self._met, self.newest()
        if newest is None or newest.place == self._last:
            return None
        if not met.frames.fits(newest.state):  # of a robot that is new: it is asked what it is
            if not finite(newest.state.q, newest.state.base):
                self._note("the robot says of a joint or its base what is no number: not shown")
            return None
        self._last = newest.place
        found = met.frames.frame(newest.state, newest.setpoint)
        if newest.took_ns is not None:
            found["values"]["answer_us"] = round(newest.took_ns / 1e3, 1)
        tasks, outcome = self._tasks.get("tasks"), self._tasks.get("outcome")
        return {
            **found,
            "holder": self._status.get("holder"),
            "stop_reason": self._status.get("stop_reason"),
            "verdicts": shown(judge_reported(self._status.get("counts") or {}, outcome)),
            "tasks": tasks if isinstance(tasks, list) else None,
        }

    def events(self) -> list[dict[str, Any]]:
        """What happened since the last call."""
        found, event = list[dict[str, Any]](), Event()
        while self._notes:
            label = self._notes.popleft()
            found.append(page_warning(label))
        if len(self._heard) == EVENTS:
            self._note(f"{EVENTS} or more events at once: only the last {EVENTS} are shown")
        while self._heard:
            try:
                event.load(self._heard.popleft())
            except WireError:  # any client may publish there
                self._note("an event was malformed: not shown")
                continue
            if event.kind == _CONSTANTS["SKIPPED"]:
                self._skipped += event.detail
                self._skipped_at_s = told(event, self._met.frames)["at_s"]
            else:
                found.append(told(event, self._met.frames))
        now = time.monotonic()
        if self._skipped and now > self._told_s + SKIPS_S:
            self._told_s, label = now, f"skipped: periods: {self._skipped}"
            found.append(page_warning(label, self._skipped_at_s))
            self._skipped = 0
        return found

    def _meet(self) -> tuple[Met, Answer | None]:
        """Ask a robot and its controller what they are, and what can be changed.

        Raises:
            LinkError, WireError: the robot does not answer, or with nonsense.
        """
        status = self._ask.status()  # first: who comes meanwhile is met again
        description = self._ask.description()
        emulator, about = self._ask.config(), self._ask.control("about") or {}
        now = self._ask.control("show")
        looks = looks_of(description, self._folder or shipped_robot(emulator))
        frames = Frames(description, looks, about, emulator)
        return Met(frames, about, None if status is None else _who(status)), now

    def _declare(self) -> list[Any]:
        sampled, declare = self._network.sampled_key, self._session.declare_subscriber
        return [
            declare(sampled(self.robot, f"state/{WIRE_VERSION}"), _keep(self._states)),
            declare(sampled(self.robot, "setpoint/*"), _keep(self._answers)),
            declare(
                self._network.key(self.robot, "events"),
                lambda sample: self._heard.append(sample.payload.to_bytes()),
            ),
        ]

    def _listen_to_all(self) -> None:
        """Of a robot that sends nothing to those who look on, as older ones, take every State."""
        if self._every is not None:
            if (sample := self._every.try_recv()) is not None:
                self._states.append((time.monotonic_ns(), sample.payload.to_bytes()))
        elif not self._states and time.monotonic() > self._began + OLD_S:
            key = self._network.state_key(self.robot)
            ring: Any = self._network.zenoh.handlers.RingChannel(1)
            self._every = self._session.declare_subscriber(key, ring)

    def _paired(
        self, stamp: int, payload: bytes, known: Mapping[int, tuple[int, bytes]]
    ) -> Pair | None:
        try:
            state = State.like(payload)
            state.load(payload)
        except WireError:
            return None
        came, raw = known.get(state.tick, (0, b""))
        try:
            setpoint = Setpoint.like(raw)
            setpoint.load(raw)
        except WireError:
            return Pair(state, None, None)
        if (setpoint.session_id, setpoint.epoch) != (state.session_id, state.epoch):
            return Pair(state, None, None)
        took = came - stamp  # negative where the two came on different ways, and crossed
        return Pair(state, setpoint, took if self._every is None and took > 0 else None)

    def _ask_again(self) -> None:
        """In a thread of its own: how the robot and its controller are."""
        while not self._closing.is_set():
            self._wanted.wait(ASK_S)
            self._wanted.clear()
            if not self.watched or self._closing.is_set():
                continue
            status = self._ask.status()
            self._status = status or {}
            if status is None:
                continue
            self._tasks = self._ask.control("tasks") or {}
            untold = status["holder"] is not None and not self._met.about
            if _who(status) != self._met.who or (untold and self._ask.control("about")):
                self._meet_again()
            elif time.monotonic() > self._show_s:
                self._show_s = time.monotonic() + SHOW_S
                self._now = self._ask.control("show") or self._now

    def _meet_again(self) -> None:
        """Learn anew what the robot and its controller are, if they tell."""
        try:
            met = self._meet()
        except Exception as error:  # noqa: BLE001 - whatever a controller says, pages go on
            self._note(f"what the robot is now could not be learnt, and is asked again: {error}")
            return
        self._met, self._now = met
        self._show_s = time.monotonic() + SHOW_S
        self._noted.clear()
        self.version += 1

    def _note(self, label: str) -> None:
        """Tell pages something, once, until the robot is met anew."""
        if label not in self._noted and len(self._noted) < EVENTS:
            self._noted.add(label)
            self._notes.append(label)


def _who(status: Answer) -> tuple[Any, Any]:
    """Whose picture it is: the holder, and the session of the robot."""
    return status["holder"], status["session_id"]


def told(event: Event, frames: Frames) -> dict[str, Any]:
    """An event as the page has it."""
    robot = frames.description
    return {"kind": "event", **page_event(event, event.tick * robot.period_s, robot.joint_names)}


def _keep(where: Kept) -> Any:
    """What Zenoh's thread does with a sample."""
    return lambda sample: where.append((time.monotonic_ns(), sample.payload.to_bytes()))
