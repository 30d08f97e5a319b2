"""Live targets from panels of Foxglove: points and poses that a user clicks.

Requests to the controller may block, so that a thread of its own sends them; of the messages that a
panel publishes meanwhile only the newest is sent.
"""

from __future__ import annotations

import json
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.messages import CDR_HEADER
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.bridge.frame_transforms import world_frame
from hoap3.tools.services.connection import Connection

MAX_BYTES = 4096
_PLACE, _TURN = ("x", "y", "z"), ("x", "y", "z", "w")
_LENGTHS = {"PointStamped": 3, "PoseStamped": 7}
Message = tuple[str, str, str, bytes]
"""Topic, schema, encoding and content of a message that a panel published."""


class PanelTargets:
    """Steers with what panels publish; becomes the operator with the first message.

    Args:
        report: receives refusals, and when steering starts and ends.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._robot: tuple[RobotDescription, str] | None = None
        self._connection: Connection | None = None
        self._targets: list[dict[str, Any]] = []
        self._waiting: dict[str, Message] = {}
        self._release = self._closing = False
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="steer", daemon=True)
        self._thread.start()

    def begin(self, description: RobotDescription, endpoint: str) -> None:
        """Steer this robot from now on."""
        with self._news:
            self._robot = description, endpoint

    def take(self, message: Message) -> None:
        """Queue a message that a panel published; a newer one of its topic replaces it."""
        with self._news:
            self._waiting[message[0]] = message
            self._news.notify()

    def release(self) -> None:
        """Release the operator role: no client is left that publishes."""
        with self._news:
            self._waiting.clear()
            self._release = True
            self._news.notify()

    def close(self) -> None:
        """Release the operator role and end the thread."""
        with self._news:
            self._closing = True
            self._news.notify()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or self._release or self._closing)
                messages = list(self._waiting.values())
                self._waiting.clear()
                ends, closing = self._release or self._closing, self._closing
                self._release, robot = False, self._robot
            if ends:
                self._let_go("no longer steers")
            if closing:
                return
            for message in messages:
                try:
                    self._steer(message, robot)
                except Hoap3Error as error:
                    self._report(f"{message[0]}: {error}")
                    if not isinstance(error, UsageError) or self._targets == []:
                        self._let_go("")

    def _steer(self, message: Message, robot: tuple[RobotDescription, str] | None) -> None:
        topic, schema, encoding, data = message
        if robot is None:
            raise UsageError("no robot is there")
        description, endpoint = robot
        clicked = read_clicked(schema, encoding, data)
        check_frame(clicked, description)
        if self._connection is None:
            self._connection = Connection(description.name, endpoint)
        if not self._targets:
            self._targets = self._connection.acquire()
            self._report(f"steers robot {description.name!r}")
        target = choose(self._targets, topic, len(clicked.values))
        try:
            self._connection.send_target(clicked.values, target)
        except Hoap3Error:
            self._targets = []  # so that the next message acquires anew
            raise

    def _let_go(self, words: str) -> None:
        if self._connection is not None:
            self._connection.close()
            if words:
                self._report(words)
        self._connection, self._targets = None, []


def check_frame(clicked: Clicked, description: RobotDescription) -> None:
    """Check that a point or pose is given in the frame of targets.

    Raises:
        UsageError: from a frame that moves.
    """
    known = [description.base_frame]
    if not description.state_arrays.get("base"):
        known += [world_frame(description), ""]  # which is the same place
    if clicked.frame not in known:
        raise UsageError(
            f"seen from the frame {clicked.frame!r:.60}: a target is taken as seen from "
            f"{known[0]!r}. Choose it as the panel's display frame"
        )


def choose(targets: Sequence[Mapping[str, Any]], topic: str, count: int) -> str:
    """Name of the live target that is meant: the last word of the topic, or the only one that fits.

    Args:
        targets: of the controller, as `acquire` tells them.
        topic: that was published on.
        count: of numbers.

    Raises:
        UsageError: none fits, or several do.
    """
    named = topic.rpartition("/")[2]
    fitting = [str(each["name"]) for each in targets if _fits(each, count)]
    if named in fitting or len(fitting) == 1:
        return named if named in fitting else fitting[0]
    all_of_them = ", ".join(f"{each['name']} ({each['dimension']} numbers)" for each in targets)
    remedy = "" if not fitting else f". End the topic in one of {', '.join(fitting)}"
    what = "a point" if count == 3 else "a pose"
    found = "none" if not fitting else str(len(fitting))
    raise UsageError(f"{found} of the live targets take {what}: {all_of_them}{remedy}")


def _fits(target: Mapping[str, Any], count: int) -> bool:
    """Whether a target is a point or a pose, and not forces or joints of the same number."""
    layout = ["x", "y", "z", "qx", "qy", "qz", "qw"][:count]
    return bool(target["layout"] == layout)


@dataclass(frozen=True)
class Clicked:
    """A point or a pose, and the frame that it is seen from.

    Attributes:
        frame: "" where none is named.
        values: x, y, z [m]; of a pose also qx, qy, qz, qw.
    """

    frame: str
    values: tuple[float, ...]


def read_clicked(schema: str, encoding: str, data: bytes) -> Clicked:
    """Read a message that a client has published.

    Args:
        schema: name of its type, as ROS 1 or ROS 2 has it.
        encoding: `json` or `cdr`.
        data: the message.

    Raises:
        UsageError: not one of these, or not what it says.
    """
    leaf = schema.rpartition("/")[2]
    if not schema.startswith("geometry_msgs/") or leaf not in _LENGTHS:
        raise UsageError(
            f"{schema!r:.80} is not taken as a target: publish "
            + " or ".join(f"geometry_msgs/{name}" for name in _LENGTHS)
        )
    if encoding not in {"json", "cdr"} or len(data) > MAX_BYTES:
        raise UsageError(
            f"{leaf}: {len(data)} bytes of {encoding!r:.20}; JSON or CDR of at most {MAX_BYTES} "
            "is taken"
        )
    try:
        return _from_json(leaf, data) if encoding == "json" else _from_cdr(leaf, data)
    except (
        *(ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError),
        struct.error,
    ) as error:
        raise UsageError(f"{leaf}: not such a message ({error!r:.100})") from error


def _from_json(leaf: str, data: bytes) -> Clicked:
    content = json.loads(data)
    frame = str(content.get("header", {}).get("frame_id", ""))
    if leaf == "PointStamped":
        return Clicked(frame, _named(content["point"], _PLACE))
    pose = content["pose"]
    values = _named(pose["position"], _PLACE) + _named(pose["orientation"], _TURN)
    return Clicked(frame, values)


def _named(content: Mapping[str, Any], names: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(float(content[name]) for name in names)


def _from_cdr(leaf: str, data: bytes) -> Clicked:
    if data[:4] != CDR_HEADER:
        raise ValueError("not plain CDR, little endian")
    body, count = data[4:], _LENGTHS[leaf]
    (length,) = struct.unpack_from("<I", body, 8)  # behind the stamp
    frame = body[12 : 12 + length].rstrip(b"\0").decode()
    at = -(-(12 + length) // 8) * 8
    return Clicked(frame, struct.unpack_from(f"<{count}d", body, at))
