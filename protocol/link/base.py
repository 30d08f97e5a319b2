"""What lies between a robot and its controller: the interface, and one that needs no network.

Both loops are given a link and never know which. The real ones are those over Zenoh and over
HOAP-3's own protocol.
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from hoap3.protocol.runtime.clock import Clock

if TYPE_CHECKING:
    from hoap3.protocol.link.local_control import LocalControl

Arrival = tuple[int, bytes]
"""Arrival stamp on the receiver's clock [ns], and the payload."""


@dataclass(frozen=True)
class Request:
    """Something that somebody asks of a robot, or of its controller.

    Attributes:
        verb: of a robot "description", "config", "status", "acquire", "release", "stop", "recover",
            or "gone" for a client that vanished; of a controller "change", "show" or "tasks".
        who: identity of the client, "" where it is not known.
        answer: takes the answer, a JSON object or bytes; for "gone" it does nothing.
        body: what came with it.
        local: whether it came from the robot's own machine and user, not over the network.
        present: whether the client's liveliness token is seen; counts for "acquire" only.
    """

    verb: str
    who: str
    answer: Callable[[dict[str, Any] | bytes], None]
    body: bytes = b""
    local: bool = False
    present: bool = True


class RobotLink(Protocol):
    """The robot's side; what a link does not override, it has none of."""

    @property
    def name_conflicts(self) -> int:
        """How many other robots on the network use the robot's name."""
        return 0

    def publish(self, state: bytes) -> None:
        """Send a State to whoever listens; never waits for them."""

    def drain(self) -> Sequence[Arrival]:
        """Setpoints that have arrived since the last call, oldest first."""

    def requests(self) -> Iterable[Request]:
        """Requests that have arrived since the last call."""

    def announce(self, event: bytes) -> None:
        """Send an Event to whoever listens."""
        del event

    def tokens(self) -> Sequence[tuple[str, bool]]:
        """Clients whose liveliness tokens have come (True) or gone since the last call."""
        return ()

    def look_again(self, who: str) -> None:
        """Check whether a client is alive; returns at once, and "gone" follows if it is not."""
        del who

    def counts(self) -> dict[str, int]:
        """What the link itself counts, by name."""
        return {}

    def close(self) -> None:
        """Leave the network."""


class RemoteRobotLink(RobotLink, Protocol):
    """The robot's side towards other processes.

    Attributes:
        arrival: set when something has arrived, for those who wait.
    """

    arrival: threading.Event

    def serve_also(self, local: LocalControl) -> None:
        """Take requests of the robot's own machine, too; they come first."""


class ControllerLink(Protocol):
    """The controller's side."""

    def wait(self) -> Arrival | None:
        """Block until a State newer than the last one is there; None when woken without one."""

    def publish(self, setpoint: bytes) -> None:
        """Send a Setpoint."""


DelayModel = Callable[[bytes], Iterable[tuple[int, bytes]]]
"""What becomes of an answer: pairs of (delay after the State was published [ns], bytes)."""


class LockstepLink(RobotLink):
    """Robot's side of a link on virtual time: the answer is asked for at once, and given a fate.

    Each State is handed to `exchange`, which returns the controller's answer however long that
    takes on the wall clock. `fate` then says when, how often and in which form the answer
    arrives in virtual time; "never" is an empty list. So misses, loss policies and safe stops
    run on virtual time, and a slow machine changes nothing but the duration.

    Args:
        exchange: State bytes in, Setpoint bytes out, or None where the controller keeps silent.
        clock: virtual clock of the robot.
        compute_time: delay of every answer where no `fate` is given [ns].
        fate: see above.
    """

    name_conflicts = 0  # an attribute costs the loop no call

    def __init__(
        self,
        exchange: Callable[[bytes], bytes | None],
        clock: Clock,
        compute_time: int = 200_000,
        fate: DelayModel | None = None,
    ) -> None:
        self._exchange, self._clock = exchange, clock
        self._compute_time, self._fate = compute_time, fate
        self._flying: list[tuple[int, int, bytes]] = []
        self._sent = 0
        self._requests: list[Request] = []
        self.announced: list[bytes] = []

    def publish(self, state: bytes) -> None:
        """Exchange a State for an answer and let that fly."""
        answer = self._exchange(state)
        if answer is not None:
            self.send(answer)

    def send(self, answer: bytes) -> None:
        """Let an answer to the newest State fly: at once, or later while time stands still."""
        now = self._clock.now()
        fates = ((self._compute_time, answer),) if self._fate is None else self._fate(answer)
        for delay, payload in fates:
            self._sent += 1  # keeps the order of arrivals at the same time
            heapq.heappush(self._flying, (now + delay, self._sent, payload))

    def drain(self) -> Sequence[Arrival]:
        """Answers whose virtual arrival time has come."""
        now, landed = self._clock.now(), []
        while self._flying and self._flying[0][0] <= now:
            stamp, _, payload = heapq.heappop(self._flying)
            landed.append((stamp, payload))
        return landed

    def ask(
        self, verb: str, who: str = "in process", body: bytes = b"", **given: Any
    ) -> list[dict[str, Any] | bytes]:
        """Queue a request for the robot's next tick; its answer appears in the returned list.

        Args:
            verb, who, body: of the `Request`.
            given: its `local` or `present`.
        """
        answers: list[dict[str, Any] | bytes] = []
        self._requests.append(Request(verb, who, answers.append, body, **given))
        return answers

    def requests(self) -> Iterable[Request]:
        """Requests queued by `ask`."""
        if not self._requests:
            return ()
        queued, self._requests = self._requests, []
        return queued

    def announce(self, event: bytes) -> None:
        """Keep the Event for whoever looks."""
        self.announced.append(event)

    def close(self) -> None:
        """Nothing to leave."""
