"""`hoap3.connect`: a running robot from Python, for scripts, notebooks and slow brains.

It is a client on the network like any other: never in the process of a loop.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hoap3.protocol.answers import OperatorAnswer, check_answer, parse_description
from hoap3.protocol.errors import (
    BadProblemError,
    Hoap3Error,
    LinkError,
    UsageError,
    WireError,
)
from hoap3.protocol.messages import WIRE_VERSION, Event, State, Target
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.tools.analysis.event_words import EVENT_NAMES, in_words
from hoap3.tools.services import sent
from hoap3.tools.services.client import RobotClient, place_of, wait_for
from hoap3.tools.services.find_robot import reach_robot

EVENTS = 256  # that are kept until somebody reads them
RENEWED_S = 0.5  # between two renewals of the operator's lease of 2 s
RETRY_S = 0.2


def connect(
    robot: str | None = None,
    endpoint: str | None = None,
    *,
    every_tick: bool = False,
    secure: str | os.PathLike[str] | None = None,
) -> Connection:
    """Connect to a running robot.

    Args:
        robot: its name; None: the only one that runs.
        endpoint: where it, or a router, listens; None: that of your robot of this name on this
            machine, else `tcp/127.0.0.1:7447`, or `tls/…` there.
        every_tick: be sent the State of each tick, not of each 16th alone. It costs the robot's
            machine as much as sending to a controller does.
        secure: folder of a certificate, where the robot wants one.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint, or several robots have it.
        LinkError: it cannot be reached.
        WireError: its answer makes no sense.
    """
    return Connection(robot, place_of(endpoint, secure), every_tick=every_tick)


class Connection(RobotClient):
    """A running robot, as one of its clients sees it; closed at the end of a `with`.

    Args:
        robot, endpoint, every_tick: see `connect`.

    Attributes:
        who: our name on the network.
        description: of the robot.
        checks_limits: whether points outside a target's limits raise; else they are only counted.
    """

    checks_limits = True

    def __init__(
        self, robot: str | None, endpoint: str | None = None, *, every_tick: bool = False
    ) -> None:
        robot, endpoint = reach_robot(robot, endpoint)
        super().__init__(robot, endpoint, f"client-{os.getpid()}-{secrets.token_hex(3)}")
        self._every_tick, key = every_tick, self._network.key
        self._states: Any = None
        self._events: Any = None
        self._operator: dict[str, Any] | None = None
        self._lost: Hoap3Error | None = None  # why we steer no longer
        self._number, self._epoch, self._closing = 0, 0, threading.Event()
        self._renewer: threading.Thread | None = None
        self._steering = threading.RLock()  # so that none renews what is just released
        try:
            self._token = self._session.liveliness().declare_token(
                key(robot, f"clients/{self.who}")
            )
            self._targets = self._session.declare_publisher(
                key(robot, f"targets/{self.who}"), express=True
            )
            self.description: RobotDescription = parse_description(self._ask("description"), robot)
        except BaseException:
            self._session.close()
            raise
        self._last = State.allocate(**self.description.state_lengths)
        self._has_state = False
        self._model: RobotModel | None = None
        self._refused: dict[str, int] = {}  # messages that `wait_until_reached` has raised

    def close(self) -> None:
        """Steer no longer, and leave the network."""
        if self._session.is_closed():
            return
        self._closing.set()
        if self._renewer is not None:
            self._renewer.join(timeout=self._network.QUERY_TIMEOUT_S + 1.0)
        if self._operator is not None:
            with contextlib.suppress(LinkError, UsageError, WireError):
                self.release()
        super().close()

    def state(self, timeout_s: float = 2.0) -> State:
        """The newest State that was sent to us: of the first call the first that comes. A copy.

        States of each 16th tick are sent, and where the mode changes, unless `every_tick`.

        Raises:
            LinkError: none comes.
        """
        if not self._look() and not self._has_state:
            self._wait(timeout_s)
        return self._last.copy()

    def states(self, timeout_s: float = 2.0) -> Iterator[State]:
        """Each State as it comes; where they come faster than they are taken, the newest.

        Raises:
            LinkError: none comes for so long.
        """
        while True:
            self._wait(timeout_s)
            yield self._last.copy()

    def events(self, timeout_s: float = 2.0) -> Iterator[dict[str, Any]]:
        """What happens to the robot, from the first call on; ends where nothing does for so long.

        Each is `event`, one of `Event.msg`, with `tick`, `stamp_ns`, `detail`, and `text`: what
        the detail means, with names of joints.
        """
        self._check_open()
        if self._events is None:
            ring: Any = self._network.zenoh.handlers.RingChannel(EVENTS)
            key = self._network.key(self.robot, "events")
            self._events = self._session.declare_subscriber(key, ring)
        event = Event()
        while (payload := self._next(self._events, timeout_s)) is not None:
            with contextlib.suppress(WireError):  # anybody may publish there
                event.load(payload)
                yield {
                    "event": EVENT_NAMES.get(event.kind, str(event.kind)),
                    "tick": event.tick,
                    "stamp_ns": event.stamp,
                    "detail": event.detail,
                    "text": in_words(event.kind, event.detail, self.description.joint_names),
                }

    def status(self) -> dict[str, Any]:
        """What the robot does: its mode, tick, who holds it, why it stands.

        Raises:
            LinkError, WireError: no answer, or one that makes no sense.
        """
        return self.request("status")

    def stop(self) -> dict[str, Any]:
        """Have the robot brake and stay at rest until `recover`; anybody may."""
        return self.request("stop")

    def recover(self) -> dict[str, Any]:
        """Let a stopped robot follow its controller again."""
        return self.request("recover")

    def changeable(self) -> dict[str, Any]:
        """What can be changed in the controller, and what it is now.

        Raises:
            LinkError: the robot follows no controller.
            UsageError: the controller refuses; says why.
        """
        return self.control("show")

    def change(self, what: Mapping[str, Any] | None = None, /, **more: Any) -> dict[str, Any]:
        """Change something in the controller, all of it or nothing; what it is now.

        Args:
            what: numbers by their keys as in the config, such as {"tasks.hand.kp": 40.0}.
            more: the same, where keys are Python's, such as gamma=0.8; and `over_s` [s].

        Raises:
            LinkError: the robot follows no controller.
            UsageError: it cannot be said in JSON, or the controller refuses; says why.
        """
        return self.control("change", sent.request(what, more))

    def acquire(self, timeout_s: float = 0.0) -> list[dict[str, Any]]:
        """Become the one who steers; the live targets of the controller, in their order.

        It is renewed until `release` or `close`.

        Args:
            timeout_s: for how long to try, and then to wait until the robot follows its
                controller, unless it is stopped: one that starts may have to compile first.

        Raises:
            LinkError: no controller answers.
            UsageError: somebody else steers, or the controller has no live target.
            WireError: its answer makes no sense.
        """
        until = time.monotonic() + timeout_s
        while True:
            try:
                found = self._acquire()
            except (LinkError, UsageError):
                if time.monotonic() > until:
                    raise
                time.sleep(RETRY_S)
            else:
                if found["following"] or self._stays(until):
                    break
                time.sleep(RETRY_S)
        self._keep()
        targets: list[dict[str, Any]] = found["targets"]
        return targets

    def release(self) -> None:
        """Steer no longer: somebody else may at once."""
        with self._steering:
            self._operator = self._lost = None
            self.control("release")

    def counts(self) -> dict[str, Any]:
        """Counts of the messages sent: `taken`, `late_points`, `lost`, and `refused` by reason.

        And `newest`, the number of the last message that has arrived. A full link drops messages:
        they count as lost once a later one has arrived.

        Raises:
            LinkError: no controller answers.
            UsageError: we do not steer.
        """
        with self._steering:  # so that no other thread releases it meanwhile
            self._held()
            found = self._acquire()
            newest = found.get("newest", self._number)  # controllers before this one do not tell
        counts = {name: found[name] for name in ("taken", "late_points", "refused")}
        return {**counts, "lost": found.get("lost", 0), "newest": newest}

    def _stays(self, until: float) -> bool:
        """Whether to wait for the robot to follow is in vain."""
        return time.monotonic() > until or self.status()["mode"] == "stopped"

    def _acquire(self) -> dict[str, Any]:
        with self._steering:
            found = self.control("acquire")
            check_answer(OperatorAnswer, found, f"the controller of {self.robot!r} who steers it")
            if found["epoch"] != self._epoch:  # else it counts on, also where it seemed lost
                self._epoch, self._number, self._refused = found["epoch"], 0, {}
            self._operator, self._lost = found, None
        return found

    def send_target(
        self, values: ArrayLike, target: str | None = None, first_tick: int | None = None
    ) -> int:
        """Send one target; the task goes there as fast as its bounds allow, and stays.

        Args:
            values: (d,), in the unit of the target: x, y, z [m]; an orientation is a unit
                quaternion x, y, z, w, a pose both; joints in the order of the task; forces and
                torques in that of its directions. `acquire` tells the `layout`.
            target: its name; None where there is only one.
            first_tick: from which it holds; None: at once.

        Returns:
            The message's number.

        Raises:
            UsageError: no such target, or we do not steer.
            BadProblemError: not d finite numbers, or outside the target's limits.
        """
        points = sent.numbers(values, "a target")
        if points.ndim != 1:
            raise BadProblemError(f"a target is one row of numbers (found {points.ndim} axes)")
        return self._send(points[None], 0 if first_tick is None else first_tick, 1, None, target)

    def wait_until_reached(self, timeout_s: float = 10.0) -> bool:
        """Return whether the targets sent are reached, within tolerance, before a timeout.

        Raises:
            LinkError: no controller answers.
            UsageError: we do not steer, the robot does not follow, or a target was refused.
        """
        until = time.monotonic() + timeout_s
        while True:
            over = time.monotonic() > until
            self._steers()
            with self._steering:  # so that no other thread releases it meanwhile
                self._held()
                found = self._acquire()
            before, self._refused = self._refused, found["refused"]
            sent.check_refused(found["refused"], before)
            if sent.is_reached(found, self._number, self.control("tasks")["tasks"]):
                return True
            if over:
                return False
            time.sleep(RETRY_S)

    def frame_pose(
        self, frame: str, reference: str | None = None, state: State | None = None
    ) -> np.ndarray[Any, Any]:
        """Return the measured pose of a link, (7,): x, y, z [m], qx, qy, qz, qw.

        Args:
            frame: a link of the robot, such as its tool.
            reference: the link that it is seen from; None: the base frame.
            state: of the robot; None: the newest one.

        Raises:
            FrameNotFoundError: the robot has no such link; carries those that it has.
            LinkError: no State comes.
        """
        self._model = self._model or build_model(self.description)
        q = (state or self.state()).q
        return self._model.pose_in(frame, reference or self.description.base_frame, q)

    def send_chunk(
        self,
        points: ArrayLike,
        first_tick: int,
        step_ticks: int,
        rates: ArrayLike | None = None,
        target: str | None = None,
    ) -> int:
        """Send the next points, each with its tick: the task is there at that tick.

        Behind the last point the target brakes within its bounds: where the curve still moves
        there, it comes to rest beyond that point.

        Args:
            points: (p, d), in the unit of the target; see `send_target`.
            first_tick: of the first, such as the tick of the State that the sender saw.
            step_ticks: between two points, ≥ 1.
            rates: (p, d), per second, but of an orientation ω, 3 numbers [rad/s], so that those
                of a pose are (p, 6); None: those of a smooth curve through the points.
            target: its name; None where there is only one.

        Returns:
            The message's number.

        Raises:
            UsageError: no such target, or we do not steer.
            BadProblemError: the arrays do not fit, points are outside the target's limits, or a
                tick is none.
        """
        return self._send(sent.numbers(points, "points"), first_tick, step_ticks, rates, target)

    def _send(
        self,
        points: np.ndarray[Any, Any],
        first_tick: int,
        step_ticks: int,
        rates: ArrayLike | None,
        name: str | None,
    ) -> int:
        grant = self._steers()
        number, dimension, moves = sent.place(grant["targets"], name)
        first_tick = sent.whole(first_tick, "first_tick")
        step_ticks = sent.whole(step_ticks, "step_ticks")
        speeds = np.zeros((0, moves)) if rates is None else sent.numbers(rates, "rates")
        sent.check(points, speeds, (dimension, moves), first_tick, step_ticks)
        if self.checks_limits:
            sent.check_limits(points, grant["targets"][number])
        message = Target(len(points), dimension, rates=moves if speeds.size else 0)
        message.values[:], message.rates[:] = points.ravel(), speeds.ravel()
        message.target, message.tick_step, message.first_tick = number, step_ticks, first_tick
        message.session_id, message.epoch = grant["session_id"], grant["epoch"]
        self._check_open()
        self._number += 1
        message.number = self._number
        self._targets.put(message.dump())
        return self._number

    def _steers(self) -> dict[str, Any]:
        """What an operator knows, if we are one and the robot follows.

        Raises:
            LinkError, UsageError: we are not, or it does not; say why.
        """
        grant = self._held()
        if not grant["following"]:
            with self._steering:  # so that no other thread releases it meanwhile
                self._held()
                grant = self._acquire()
        if not grant["following"]:
            remedy = f"`hoap3 recover --connect {self._endpoint}`, or `recover()`"
            raise UsageError(
                f"robot {self.robot!r} does not follow its controller now, so targets do not "
                f"count. Where it is stopped: {remedy}"
            )
        return grant

    def _held(self) -> dict[str, Any]:
        """What an operator knows, if we are one.

        Raises:
            LinkError, UsageError: we are not; say why, where we were.
        """
        self._check_open()
        lost, self._lost = self._lost, None
        if lost is not None:
            raise lost
        if self._operator is None:
            raise UsageError(
                f"we do not steer robot {self.robot!r}. Acquire first: `acquire()`; one steers at "
                "a time, until `release()`"
            )
        return self._operator

    def _keep(self) -> None:
        """Have a thread renew the lease."""
        if self._renewer is None or not self._renewer.is_alive():
            self._renewer = threading.Thread(target=self._renew, name="renew", daemon=True)
            self._renewer.start()

    def _renew(self) -> None:
        """In a thread of its own: keep the lease, as long as we have it; the next send tells."""
        while not self._closing.wait(RENEWED_S):
            with self._steering:
                if self._operator is None:
                    continue
                try:
                    self._acquire()
                except (LinkError, UsageError, WireError) as error:
                    self._operator, self._lost = None, error

    def _look(self) -> bool:
        """Take the newest State, if one has come."""
        self._check_open()
        if self._states is None:
            ring: Any = self._network.zenoh.handlers.RingChannel(1)
            key = self._network.state_key(self.robot)
            if not self._every_tick:
                key = self._network.sampled_key(self.robot, f"state/{WIRE_VERSION}")
            self._states = self._session.declare_subscriber(key, ring)
        sample = self._states.try_recv()
        if sample is None:
            return False
        try:
            self._last.load(sample.payload.to_bytes())
        except WireError:
            return False
        self._has_state = True
        return True

    def _wait(self, timeout_s: float) -> None:
        """Until a State has come."""
        if not wait_for(self._look, timeout_s):
            raise LinkError(f"no State of robot {self.robot!r} came within {timeout_s:g} s")

    def _next(self, subscriber: Any, timeout_s: float) -> bytes | None:
        sample = wait_for(subscriber.try_recv, timeout_s)
        return None if sample is None else bytes(sample.payload.to_bytes())
