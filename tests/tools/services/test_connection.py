"""`hoap3.connect` without a network: what it sends, and what it refuses before it does."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.small_arm import arm

import hoap3
from hoap3.protocol.errors import BadProblemError, LinkError, UsageError, WireError
from hoap3.protocol.link import zenoh_session
from hoap3.protocol.link.session_limits import MAX_REQUEST_BYTES
from hoap3.protocol.messages import Event, State, Target
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.tools.services import client, find_robot
from hoap3.tools.services.connection import Connection

ROBOT = arm().name


class Network:
    """A robot that answers, and whose controller does; what was asked of it, and sent."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, bytes]] = []
        self.sent: list[bytes] = []
        self.samples: list[Any] = []
        self.looked: set[int] = set()
        self.following = self.answers = True
        self.more: dict[str, Any] = {}

    def ask(self, _: Any, robot: str, verb: str, who: str, body: bytes, whom: str) -> bytes | None:
        del robot, who
        self.asked.append((verb, body))
        if verb == "description":
            return arm().to_json()
        if whom == "control" and not self.answers:
            return None
        target = {"name": "hand", "dimension": 3, "rates": 3}
        grant = {"epoch": 1, "session_id": 7, "following": self.following, "targets": [target]}
        counts = {"taken": 0, "late_points": 0, "refused": {}}
        return json.dumps({"error": None, "now": {**grant, **counts, **self.more}}).encode()

    def session(self, _: Any, robot: str) -> Any:
        """As zenoh has it."""
        subscriber = SimpleNamespace(try_recv=self._sample)
        return SimpleNamespace(
            is_closed=lambda: False,
            close=lambda: None,
            liveliness=lambda: SimpleNamespace(declare_token=lambda _: None),
            declare_publisher=lambda *_, **__: SimpleNamespace(put=self.sent.append),
            declare_subscriber=lambda *_: subscriber,
        )

    def _sample(self) -> Any:
        self.looked.add(threading.get_ident())
        return self.samples.pop(0) if self.samples else None

    def verbs(self) -> list[str]:
        """What was asked, but for the description."""
        return [verb for verb, _ in self.asked if verb != "description"]


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    made = Network()
    monkeypatch.setattr(zenoh_session, "ask", made.ask)
    monkeypatch.setattr(zenoh_session, "check_unique", lambda *_: None)
    monkeypatch.setattr(find_robot, "listens", lambda _: True)
    monkeypatch.setattr(zenoh_session, "open_session", made.session)
    return made


@pytest.fixture
def robot(network: Network) -> Iterator[Connection]:
    with hoap3.connect(ROBOT) as connected:
        yield connected


def test_what_came_while_the_process_was_stopped_is_not_missed(
    network: Network, robot: Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock of its own, which goes on by an hour between two looks."""
    event = Event()
    event.kind = Event.schema.constants["AT_REST"]
    payload = event.dump()
    now = 0.0

    def stopped(_: float) -> None:
        nonlocal now
        now += 3600.0
        network.samples = [SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: payload))]

    clock = SimpleNamespace(monotonic=lambda: now, sleep=stopped)
    monkeypatch.setattr(client, "time", clock)
    assert next(robot.events(timeout_s=1.0))["event"] == "AT_REST"


@pytest.mark.parametrize(
    ("first", "step"), [(1.5, 50), (0, 50.0), ("now", 50), (0, None), (-1, 50), (0, 0), ([1], 50)]
)
def test_a_tick_that_is_none_is_refused(first: Any, step: Any, robot: Connection) -> None:
    robot.acquire()
    with pytest.raises(BadProblemError):
        robot.send_chunk(np.zeros((2, 3)), first, step)


def test_a_target_from_a_tick_that_is_none_is_refused(robot: Connection, network: Network) -> None:
    robot.acquire()
    tick: Any = "now"
    with pytest.raises(BadProblemError):
        robot.send_target([0.0, 0.0, 0.0], first_tick=tick)
    assert not network.sent


def test_a_whole_number_of_numpy_is_a_tick(robot: Connection, network: Network) -> None:
    robot.acquire()
    robot.send_chunk(np.zeros((2, 3)), np.uint64(9), np.int32(50))
    (payload,) = network.sent
    sent = Target.like(payload)
    sent.load(payload)
    assert (sent.first_tick, sent.tick_step) == (9, 50)


def test_numbers_of_numpy_are_changed_as_plain_ones(robot: Connection, network: Network) -> None:
    weights = np.array([1.0, 2.0])
    robot.change({"tasks": {"hand": {"weights": weights}}, "count": np.int64(3)}, gamma=np.ones(()))
    verb, body = network.asked[-1]
    assert verb == "change"
    expected = {"tasks": {"hand": {"weights": [1.0, 2.0]}}, "count": 3, "gamma": 1.0}
    assert json.loads(body) == expected


def use_all(robot: Connection) -> None:
    """Each way to steer, and the question what came of it, are refused."""
    for use in (
        lambda: robot.send_target([0.0, 0.0, 0.0]),
        lambda: robot.send_chunk(np.zeros((2, 3)), 0, 50),
        robot.counts,
    ):
        with pytest.raises(UsageError):
            use()


def test_who_never_acquired_does_not_steer(robot: Connection, network: Network) -> None:
    use_all(robot)
    assert not network.verbs()
    assert not network.sent


def test_who_released_steers_no_longer_until_he_acquires(
    robot: Connection, network: Network
) -> None:
    robot.acquire()
    robot.send_target([0.0, 0.0, 0.0])
    robot.release()
    use_all(robot)
    assert network.verbs()[-1] == "release"
    assert len(network.sent) == 1
    robot.acquire()
    robot.send_target([0.0, 0.0, 0.0])
    assert len(network.sent) == 2


def test_messages_of_one_epoch_count_on_where_a_renewal_got_no_answer(
    robot: Connection, network: Network
) -> None:
    """Else the controller, which heard of no loss, refuses them as behind."""
    robot.acquire()
    assert [robot.send_target([0.0, 0.0, 0.0]) for _ in range(3)] == [1, 2, 3]
    network.answers = False
    deadline = time.monotonic() + 60.0
    while robot._operator is not None and time.monotonic() < deadline:
        time.sleep(0.01)
    network.answers = True
    robot.acquire()
    assert robot.send_target([0.0, 0.0, 0.0]) == 4


def test_who_steers_goes_on_when_the_robot_follows_again(
    robot: Connection, network: Network
) -> None:
    network.following = False
    robot.acquire(timeout_s=-1.0)
    with pytest.raises(UsageError):
        robot.send_target([0.0, 0.0, 0.0])
    network.following = True
    robot.send_target([0.0, 0.0, 0.0])
    assert len(network.sent) == 1


class ReleasedBefore:
    """A lock that somebody else, who releases, has had just before its first holder gets it."""

    def __init__(self, robot: Connection) -> None:
        self._robot, self._lock, self._first = robot, robot._steering, True

    def __enter__(self) -> None:
        if self._first:
            self._first = False
            self._robot.release()
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


@pytest.mark.parametrize(
    "use", [lambda robot: robot.send_target([0.0, 0.0, 0.0]), lambda robot: robot.counts()]
)
def test_nothing_steers_again_after_a_release_that_comes_in_between(
    use: Any, robot: Connection, network: Network
) -> None:
    network.following = False
    robot.acquire(timeout_s=-1.0)
    plain, robot._steering = robot._steering, ReleasedBefore(robot)
    with pytest.raises(UsageError):
        use(robot)
    robot._steering = plain
    assert network.verbs()[-1] == "release"
    assert not network.sent


ROUND: dict[str, Any] = {}
ROUND["gamma"] = ROUND


@pytest.mark.parametrize(
    "what",
    [
        "gamma",
        3.0,
        ["gamma"],
        {3: 0.5},
        {"gamma": object()},
        {"gamma": 1j},
        {"gamma": np.complex128(1j)},
        {"gamma": {0.5}},
        {"tasks": {("hand", "kp"): 1.0}},
        ROUND,
        {"gamma": "x" * MAX_REQUEST_BYTES},
    ],
)
def test_a_change_that_json_does_not_have_or_is_too_long_is_refused(
    what: Any, robot: Connection, network: Network
) -> None:
    with pytest.raises(UsageError):
        robot.change(what)
    assert "change" not in network.verbs()


def test_of_a_controller_that_is_silent_lockstep_is_told(
    robot: Connection, network: Network
) -> None:
    network.answers = False
    with pytest.raises(LinkError, match="lockstep"):
        robot.acquire()


@pytest.mark.parametrize(
    "wrong", [{"epoch": None}, {"following": 1}, {"targets": [{"name": "hand"}]}, {"refused": 3}]
)
def test_a_controller_that_answers_nonsense_is_no_operators(
    wrong: dict[str, Any], robot: Connection, network: Network
) -> None:
    network.more = wrong
    with pytest.raises(WireError):
        robot.acquire()
    network.more = {}
    robot.acquire()
    network.more = wrong  # from the next renewal on
    deadline = time.monotonic() + 60.0
    while robot._operator is not None and time.monotonic() < deadline:
        time.sleep(0.01)
    with pytest.raises(WireError):
        robot.send_target([0.0, 0.0, 0.0])
    network.more = {}
    robot.acquire()
    robot.send_target([0.0, 0.0, 0.0])


LIMITED = {
    "name": "hand",
    "dimension": 7,
    "rates": 6,
    "layout": ["x", "y", "z", "qx", "qy", "qz", "qw"],
    "lower": [-1.0, None, 0.0],
    "upper": [1.0, None, None],
    "at_rest": False,
}
TURN = [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("place", "word"),
    [([1.5, 0, 0], "x is 1.5: send -1 to 1"), ([0, 9, -1], "z is -1: send 0 to inf")],
)
def test_a_target_outside_its_limits_is_not_sent(place, word, robot, network) -> None:
    network.more = {"targets": [LIMITED]}
    robot.acquire()
    robot.send_target([0, 1e6, 1, *TURN])
    with pytest.raises(BadProblemError, match=word):
        robot.send_target([*place, *TURN])
    with pytest.raises(BadProblemError, match=word):
        robot.send_chunk([[0, 0, 1, *TURN], [*place, *TURN]], 5, 10)
    assert len(network.sent) == 1
    robot.checks_limits = False
    robot.send_target([*place, *TURN])
    assert len(network.sent) == 2


@pytest.mark.parametrize(
    ("at_rest", "within", "judged", "newest", "reached"),
    [
        (True, True, True, 1, True),
        (False, True, True, 1, False),
        (True, False, True, 1, False),
        (True, False, False, 1, True),
        (True, True, True, 0, False),
    ],
)
def test_a_target_is_reached_at_rest_and_within_tolerance(
    at_rest, within, judged, newest, reached, robot, network
) -> None:
    target = {**LIMITED, "at_rest": at_rest}
    tasks = [{"within": within, "judged": judged}]
    network.more = {"targets": [target], "tasks": tasks, "newest": newest}
    robot.acquire()
    robot.send_target([0, 0, 1, *TURN])
    assert robot.wait_until_reached(0.0) is reached


def test_a_refused_target_is_not_waited_for(robot, network) -> None:
    network.more = {"targets": [LIMITED], "tasks": [], "newest": 1}
    robot.acquire()
    robot.send_target([0, 0, 1, *TURN])
    network.more["refused"] = {"too_fast": 1}
    with pytest.raises(UsageError, match="too_fast: 1"):
        robot.wait_until_reached(5.0)
    assert not robot.wait_until_reached(0.0)  # it is raised once


def test_the_pose_of_a_frame_is_that_of_the_joints(robot) -> None:
    description = arm()
    state = State.allocate(**description.state_lengths)
    state.q[:] = np.linspace(0.1, 0.4, description.n)
    model = build_model(description)
    frame = description.frames[-1]
    found = robot.frame_pose(frame, state=state)
    expected = model.pose_in(frame, description.base_frame, state.q)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(robot.frame_pose(frame, frame, state), [0, 0, 0, *TURN], atol=1e-12)
