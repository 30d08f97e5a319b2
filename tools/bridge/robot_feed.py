"""Messages of a running robot for a bridge, which waits for the robot and outlives it.

A bridge is an observer. It receives every 16th State and the Setpoint that answers it
(`protocol/link/zenoh_link.py`), 62.5 Hz for a robot at 1 kHz. Of States and Setpoints only the
newest is kept, of events the last 256.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable
from typing import Any, Protocol

from hoap3.protocol.answers import parse_description
from hoap3.protocol.errors import Hoap3Error, LinkError, UsageError, WireError
from hoap3.protocol.messages import WIRE_VERSION, Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.logs.log_format import JointStates
from hoap3.tools.services.client import client_settings, unanswered

PERIOD_S = 0.01  # between two polls
EVENTS = 256  # that are kept meanwhile
SILENCE_S = 1.0  # without a State, after which the liveliness of the robot is checked
RETRY_S = 0.5


class Viewer(Protocol):
    """Receiver of a robot's messages; one thread calls all methods, which must not block."""

    def begin(self, description: RobotDescription, endpoint: str) -> None:
        """Start with a robot, for the first time or again, at the endpoint where it was reached."""

    def state(self, payload: bytes, state: State) -> None:
        """Receive a State, as bytes and decoded."""

    def setpoint(self, payload: bytes) -> None:
        """Receive a Setpoint."""

    def event(self, payload: bytes) -> None:
        """Receive an Event."""

    def idle(self) -> None:
        """Called once in each period, whether a message came or not."""

    def end(self) -> None:
        """Stop: the robot is gone."""


def joint_states(description: RobotDescription) -> JointStates:
    """Return what packs `sensor_msgs/msg/JointState` from this robot's States, as a log has it."""
    made = JointStates(description.joint_names)
    lengths = dict.fromkeys(State.schema.arrays, 0) | description.state_lengths
    made.learn(State.schema.dtype(lengths), lengths)
    return made


def feed(
    find: Callable[[], tuple[str, str]],
    viewer: Viewer,
    should_stop: Callable[[], bool],
    report: Callable[[str], None],
) -> None:
    """Show a robot to a viewer until it is to stop; waits for the robot, at the start and later.

    Args:
        find: gives the robot's name, and where it listens. What it found first is kept.
        viewer: receives all messages.
        should_stop: is called in each period.
        report: receives notes on robots that appear and disappear.

    Raises:
        UsageError: the robot's name or its endpoint is wrong, or several run.
    """
    found: tuple[str, str] | None = None
    missing = False
    while not should_stop():
        try:
            place = found or find()
            with _Robot(*place) as robot:
                found = place
                report(f"robot {robot.name!r} is there")
                missing = False
                viewer.begin(robot.description, place[1])
                try:
                    robot.show(viewer, should_stop)
                finally:
                    viewer.end()
                    if robot.malformed:
                        report(f"malformed messages of {robot.name!r} not shown: {robot.malformed}")
        except UsageError:
            raise
        except Hoap3Error as error:
            if not missing:
                report(f"{error}; waiting")
            missing = True
        until = time.monotonic() + RETRY_S
        while missing and not should_stop() and time.monotonic() < until:
            viewer.idle()
            time.sleep(PERIOD_S)


class _Robot:
    """One run of a robot, as one of its clients sees it.

    Attributes:
        malformed: count of messages that could not be read.

    Raises:
        LinkError: it cannot be reached.
        WireError: its description makes no sense.
    """

    def __init__(self, name: str, endpoint: str) -> None:
        from hoap3.protocol.link import zenoh_session as network

        self.name, self._network = name, network
        settings = client_settings(endpoint)
        who = network.session_name(settings, f"bridge-{os.getpid()}-{secrets.token_hex(3)}")
        self._session = network.open_session(settings, name)
        try:
            network.check_unique(self._session, name)
            raw = network.ask(self._session, name, "description", who)
            if raw is None:
                raise LinkError(
                    f"no robot called {name!r} answers at {endpoint}{unanswered(settings)}"
                )
            self.description = parse_description(raw, name)
            ring = network.zenoh.handlers.RingChannel
            keys = (
                network.sampled_key(name, f"state/{WIRE_VERSION}"),
                network.sampled_key(name, "setpoint/*"),
            )
            declare = self._session.declare_subscriber
            self._states, self._setpoints = (declare(key, ring(1)) for key in keys)
            self._events = declare(network.key(name, "events"), ring(EVENTS))
        except BaseException:
            self._session.close()
            raise
        self._state = State.allocate(**self.description.state_lengths)
        self._run: int | None = None  # the robot's session
        self.malformed = 0

    def __enter__(self) -> _Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def show(self, viewer: Viewer, should_stop: Callable[[], bool]) -> None:
        """Until the robot is gone, or is another one.

        Raises:
            LinkError: it is gone.
        """
        heard, misfit = time.monotonic(), False
        while not should_stop():
            began = time.monotonic()
            if (payload := self._newest(self._states, State)) is not None:
                (run,) = State.scalars(payload, "session_id")
                if self._run is not None and run != self._run:
                    return
                try:
                    self._state.load(payload)
                except WireError:  # any client may publish there; the robot may have changed
                    misfit = True
                    self.malformed += 1
                else:
                    self._run, heard, misfit = run, began, False
                    viewer.state(payload, self._state)
            if (payload := self._newest(self._setpoints, Setpoint)) is not None:
                viewer.setpoint(payload)
            while (payload := self._newest(self._events, Event)) is not None:
                viewer.event(payload)
            viewer.idle()
            if began - heard > SILENCE_S:
                if not self._network.is_alive(self._session, self.name):
                    raise LinkError(f"robot {self.name!r} is gone")
                if misfit:
                    return
                heard = began
            time.sleep(max(0.0, began + PERIOD_S - time.monotonic()))

    def _newest(self, subscriber: Any, message: Any) -> bytes | None:
        """Return the newest valid message, or None."""
        while (sample := subscriber.try_recv()) is not None:
            payload = bytes(sample.payload.to_bytes())
            try:
                message.schema.lengths_in(payload)
                message.scalars(payload, "session_id")
            except WireError:
                self.malformed += 1
                continue
            return payload
        return None
