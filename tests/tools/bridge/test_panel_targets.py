"""What a panel publishes becomes a target of the controller, or is refused with a reason."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from looked_at import until
from rosbags.typesys import Stores, get_typestore
from support.small_arm import arm

from hoap3.protocol.errors import LinkError, UsageError
from hoap3.tools.bridge import panel_targets
from hoap3.tools.bridge.panel_targets import (
    Clicked,
    PanelTargets,
    check_frame,
    choose,
    read_clicked,
)

ROBOT = arm()
POINT = {"name": "hand", "dimension": 3, "layout": ["x", "y", "z"]}
OTHER = {**POINT, "name": "elbow"}
POSE = {"name": "tool", "dimension": 7, "layout": ["x", "y", "z", "qx", "qy", "qz", "qw"]}
FORCE = {"name": "push", "dimension": 3, "layout": ["fx", "fy", "fz"]}
CLICK = {"header": {"frame_id": "world"}, "point": {"x": 0.1, "y": 0.2, "z": 0.3}}
PLACE = {"position": CLICK["point"], "orientation": {"x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8}}


def test_a_point_and_a_pose_are_read_from_json() -> None:
    data = json.dumps(CLICK).encode()
    for schema in ("geometry_msgs/PointStamped", "geometry_msgs/msg/PointStamped"):
        assert read_clicked(schema, "json", data) == Clicked("world", (0.1, 0.2, 0.3))
    data = json.dumps({"header": {"frame_id": "a"}, "pose": PLACE}).encode()
    found = read_clicked("geometry_msgs/PoseStamped", "json", data)
    assert found == Clicked("a", (0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8))


@pytest.mark.parametrize("frame", ["", "a", "world", "left_foot"])
def test_a_point_and_a_pose_are_read_from_cdr(frame: str) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    header = kinds["Header"](kinds["Time"](1, 2), frame)
    point, turn = kinds["Point"](0.1, 0.2, 0.3), kinds["Quaternion"](0.0, 0.6, 0.0, 0.8)
    place, whole = (0.1, 0.2, 0.3), (0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8)
    for leaf, part, values in (
        ("Point", point, place),
        ("Pose", kinds["Pose"](point, turn), whole),
    ):
        name = f"geometry_msgs/msg/{leaf}Stamped"
        data = bytes(store.serialize_cdr(store.types[name](header, part), name))
        assert read_clicked(name, "cdr", data) == Clicked(frame, values)


NO_POINTS = [
    *(b"{}", b"[]", b"\xff", b"[" * 4000, b" " * 4097, b'{"header": 3, "point": {}}'),
    *(b'{"point": {"x": %s, "y": 0, "z": 0}}' % x for x in (b'"a"', b"null")),
]
NO_CDR = b"", b"\0\1\0\0" + bytes(20), b"\0\0\0\0" + bytes(60), b"\0\1\0\0" + b"\xff" * 60


@pytest.mark.parametrize(
    ("schema", "encoding", "data"),
    [
        ("geometry_msgs/Twist", "json", b"{}"),
        ("other_msgs/PointStamped", "json", b"{}"),
        ("geometry_msgs/PointStamped", "protobuf", b"{}"),
        *(("geometry_msgs/PointStamped", "json", data) for data in NO_POINTS),
        *(("geometry_msgs/PointStamped", "cdr", data) for data in NO_CDR),
    ],
)
def test_what_is_no_point_is_refused(schema: str, encoding: str, data: bytes) -> None:
    with pytest.raises(UsageError):
        read_clicked(schema, encoding, data)


def test_a_frame_that_is_not_the_base_frame_is_refused() -> None:
    for frame in ("", "world", ROBOT.base_frame):
        check_frame(Clicked(frame, (0.0, 0.0, 0.0)), ROBOT)
    free = ROBOT.model_copy(update={"state_arrays": {"base": 13}})
    check_frame(Clicked(ROBOT.base_frame, (0.0, 0.0, 0.0)), free)
    for frame, robot in ((ROBOT.frames[-1], ROBOT), ("world", free), ("", free)):
        with pytest.raises(UsageError, match=ROBOT.base_frame):
            check_frame(Clicked(frame, (0.0, 0.0, 0.0)), robot)


def test_the_target_that_fits_is_meant_or_the_one_that_the_topic_names() -> None:
    assert choose([POINT, POSE, FORCE], "/clicked_point", 3) == "hand"
    assert choose([POINT, POSE], "/clicked_pose", 7) == "tool"
    assert choose([POINT, OTHER], "/steer/elbow", 3) == "elbow"
    for targets, topic, count in (
        ([POINT, OTHER], "/clicked_point", 3),
        ([POSE, FORCE], "/clicked_point", 3),
        ([POSE, FORCE], "/steer/push", 3),
        ([POINT], "/clicked_pose", 7),
    ):
        with pytest.raises(UsageError):
            choose(targets, topic, count)


class Steered:
    """Stands for a connection; what became of each."""

    made: list[Steered]
    error: Exception | None = None

    def __init__(self, robot: str, endpoint: str) -> None:
        self.to, self.sent, self.closed = (robot, endpoint), list[Any](), False
        self.acquired = 0
        self.gate = threading.Event()
        Steered.made.append(self)

    def acquire(self) -> list[dict[str, Any]]:
        if Steered.error is not None:
            raise Steered.error
        self.acquired += 1
        return [POINT]

    def send_target(self, values: Any, target: str) -> None:
        self.sent.append((tuple(values), target))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def steering(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    monkeypatch.setattr(panel_targets, "Connection", Steered)
    monkeypatch.setattr(Steered, "error", None)
    Steered.made, told = [], list[str]()
    targets = PanelTargets(told.append)
    targets.begin(ROBOT, "tcp/here:1")
    yield SimpleNamespace(targets=targets, told=told)
    targets.close()
    assert all(each.closed for each in Steered.made)


def click(x: float) -> tuple[str, str, str, bytes]:
    """What a panel publishes."""
    content = {**CLICK, "point": {"x": x, "y": 0.0, "z": 0.0}}
    return "/clicked_point", "geometry_msgs/PointStamped", "json", json.dumps(content).encode()


def test_the_first_message_acquires_and_the_last_client_releases(steering: Any) -> None:
    assert not Steered.made
    for x in (1.0, 2.0):
        steering.targets.take(click(x))
        until(lambda x=x: Steered.made and Steered.made[0].sent[-1:] == [((x, 0.0, 0.0), "hand")])
    (made,) = Steered.made
    assert (made.to, made.acquired, made.closed) == ((ROBOT.name, "tcp/here:1"), 1, False)
    steering.targets.release()
    until(lambda: made.closed)
    assert len(steering.told) == 2


def test_who_may_not_steer_is_told_and_the_next_message_tries_again(steering: Any) -> None:
    Steered.error = UsageError("somebody else steers")
    steering.targets.take(click(1.0))
    until(lambda: any("somebody else" in each for each in steering.told))
    Steered.error = LinkError("no controller")
    steering.targets.take(click(1.0))
    until(lambda: any("no controller" in each for each in steering.told))
    Steered.error = None
    steering.targets.take(click(2.0))
    until(lambda: Steered.made[-1].sent)
    assert [each.closed for each in Steered.made] == [True, True, False]


def test_what_is_refused_keeps_the_operators_place(steering: Any) -> None:
    steering.targets.take(click(1.0))
    until(lambda: Steered.made and Steered.made[0].sent)
    steering.targets.take(("/clicked_point", "geometry_msgs/Twist", "json", b"{}"))
    until(lambda: any("Twist" in each for each in steering.told))
    steering.targets.take(click(2.0))
    until(lambda: len(Steered.made[0].sent) == 2)
    assert len(Steered.made) == 1


def test_of_what_waits_the_newest_counts(steering: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, began = threading.Event(), threading.Event()
    plain = Steered.send_target

    def slow(self: Steered, values: Any, target: str) -> None:
        began.set()
        gate.wait(20.0)
        plain(self, values, target)

    monkeypatch.setattr(Steered, "send_target", slow)
    steering.targets.take(click(0.0))
    assert began.wait(20.0)
    for x in np.arange(1.0, 50.0):
        steering.targets.take(click(x))
    gate.set()
    until(lambda: Steered.made[0].sent[-1:] == [((49.0, 0.0, 0.0), "hand")])
    assert len(Steered.made[0].sent) == 2
