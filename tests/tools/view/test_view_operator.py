"""What a page may do to a robot that notes it: one steers, and nobody waits for another."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest
from view_samples import BOUNDS, HAND, UR5, config_of, task

from hoap3.protocol.errors import BadProblemError, LinkError, UsageError
from hoap3.protocol.messages import State
from hoap3.tools.view.picture.frame import Frames
from hoap3.tools.view.picture.geometry import Looks
from hoap3.tools.view.steering import motion, operator
from hoap3.tools.view.steering.operator import Operator

PATIENCE_S = 60.0
AIM = [0.4, 0.1, 0.3]


class NotingRobot:
    """Stands for a connection."""

    who = "us"

    def __init__(self) -> None:
        self.sent: list[list[float]] = []
        self.done: list[str] = []
        self.lost = ""
        self.gets = True
        self.recovers = False
        self.news = threading.Condition()
        self.patient, self.let = threading.Event(), threading.Event()
        self.let.set()

    def note(self, what: str) -> None:
        with self.news:
            self.done.append(what)
            self.news.notify_all()

    def wait(self) -> None:
        self.patient.set()
        assert self.let.wait(PATIENCE_S)

    def acquire(self) -> list[Any]:
        self.wait()
        self.note("acquire")
        return []

    def release(self) -> None:
        self.note("release")

    def send_target(self, values: list[float], name: str) -> int:
        if self.lost:
            raise LinkError(self.lost)
        self.sent.append(values)
        self.note("target")
        return len(self.sent)

    def counts(self) -> dict[str, Any]:
        return {"refused": {}, "newest": len(self.sent) if self.gets else 0}

    def stop(self) -> dict[str, Any]:
        self.note("stop")
        return {}

    def recover(self) -> dict[str, Any]:
        self.wait()
        return {"recovered": self.recovers, "mode": "active"}

    def change(self, what: dict[str, Any], **more: Any) -> dict[str, Any]:
        self.wait()
        return what

    def close(self) -> None:
        self.note("close")


class Stage:
    """An operator that runs, and what it told all pages."""

    def __init__(self) -> None:
        config = config_of(task("frame_position"))
        about = {"config": config, "targets": [{**HAND, **BOUNDS}]}
        state = State.allocate(**UR5.state_lengths)
        state.q[:] = state.reference[:] = UR5.initial_position
        self.robot, self.told = NotingRobot(), list[dict[str, Any]]()
        self.source: Any = SimpleNamespace(
            frames=Frames(UR5, Looks({}), about),
            stop=self.robot.stop,
            newest=lambda: SimpleNamespace(state=state),
            operator=None,
            robot="ur5",
            endpoint="",
            look_again=lambda: None,
            changed=lambda _: None,
            changeable=list,
        )
        self.opened = 0

        def connect(*_: object) -> Any:
            self.opened += 1
            return self.robot

        self.operator = Operator(self.source, self.told.append, connect)

    async def begin(self, page: str, **do: Any) -> asyncio.Task[dict[str, Any]]:
        """Have a page ask for something that the robot lets wait."""
        self.robot.let.clear()
        asking = asyncio.create_task(self.operator.act(page, do))
        await asyncio.to_thread(self.robot.patient.wait, PATIENCE_S)
        return asking

    async def drag_to_aim(self) -> None:
        """Have a page become the operator and drag, until the robot is sent the target."""
        told = await self.operator.act("page", {"verb": "acquire"})
        assert told["targets"][0]["name"] == "hand"
        assert self.operator.move("page", drag(AIM))
        await self.until(lambda: self.robot.sent == [AIM])

    async def until(self, true: Callable[[], bool]) -> None:
        """Wait for news of the robot until something is so."""

        def wait() -> bool:
            with self.robot.news:
                return self.robot.news.wait_for(true, PATIENCE_S)

        assert await asyncio.to_thread(wait)


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Stage], Awaitable[None]]], Stage]:
    """Plays a story with an operator that runs; returns what is left of it."""
    monkeypatch.setattr(operator, "SETTLE_S", 0.01)
    monkeypatch.setattr(operator, "AGAIN_S", 0.01)
    monkeypatch.setattr(operator, "HOLD_S", PATIENCE_S)

    def play(story: Callable[[Stage], Awaitable[None]]) -> Stage:
        async def whole() -> Stage:
            stage = Stage()
            running = asyncio.create_task(stage.operator.run())
            try:
                await asyncio.wait_for(story(stage), PATIENCE_S)
            finally:
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
                await asyncio.to_thread(stage.operator.close)
            return stage

        return asyncio.run(whole())

    return play


def drag(values: list[float]) -> dict[str, Any]:
    return {"verb": "target", "name": "hand", "values": values}


def test_what_a_page_drags_is_sent_and_held_when_it_goes(play):
    async def story(stage: Stage) -> None:
        await stage.drag_to_aim()
        stage.operator.left("page")
        await stage.until(lambda: "release" in stage.robot.done)
        assert stage.operator.says("page") == "none"

    stage = play(story)
    held = stage.robot.sent[-1]
    assert len(stage.robot.sent) == 2
    assert held != AIM
    assert stage.robot.done.index("release") > stage.robot.done.index("target")


@pytest.mark.parametrize("released", [True, False])
def test_a_hold_that_is_lost_on_its_way_is_sent_again_before_another_may_steer(
    play, released, monkeypatch
):
    monkeypatch.setattr(motion, "LEASE_S", PATIENCE_S)

    async def story(stage: Stage) -> None:
        stage.robot.gets = False
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", drag(AIM))
        await stage.until(lambda: AIM in stage.robot.sent)
        stage.operator.move("page", {"verb": "drop"})
        if released:
            going = asyncio.create_task(stage.operator.act("page", {"verb": "release"}))
        else:
            stage.operator.left("page")
        await stage.until(lambda: len(stage.robot.sent) > 4)
        assert "release" not in stage.robot.done
        stage.robot.gets = True
        await stage.until(lambda: "release" in stage.robot.done)
        if released:
            await going

    stage = play(story)
    assert AIM not in stage.robot.sent[1:]


def test_what_is_dragged_next_replaces_a_hold_that_is_lost(play):
    async def story(stage: Stage) -> None:
        await stage.drag_to_aim()
        stage.robot.gets = False
        stage.operator.move("page", {"verb": "drop"})
        await stage.until(lambda: len(stage.robot.sent) > 1)
        stage.operator.move("page", drag(AIM))
        await stage.until(lambda: stage.robot.sent[-1] == AIM)
        stage.robot.gets = True

    play(story)


def place(values: list[float]) -> dict[str, Any]:
    return {"verb": "place", "name": "hand", "values": values}


def test_an_entered_pose_is_sent_until_it_arrives_and_goes_on_while_its_page_is_silent(
    play, monkeypatch
):
    monkeypatch.setattr(motion, "SILENT_S", 0.0)
    monkeypatch.setattr(motion, "LEASE_S", PATIENCE_S)

    async def story(stage: Stage) -> None:
        stage.robot.gets = False
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", place(AIM))
        await stage.until(lambda: len(stage.robot.sent) > 2)
        stage.robot.gets = True
        assert stage.operator.asked == {"hand": AIM}
        stage.operator.move("page", {"verb": "drop"})  # of a key, which was not this target's
        stage.operator.left("page")
        await stage.until(lambda: "release" in stage.robot.done)

    stage = play(story)
    assert all(sent == AIM for sent in stage.robot.sent[:-1])
    assert stage.robot.sent[-1] != AIM  # held when the page was closed


def test_an_entered_pose_outside_the_limits_is_refused_with_the_limits(play):
    async def story(stage: Stage) -> None:
        (target,) = stage.source.frames.targets
        target.told.update(lower=[-1.0] * 3, upper=[1.0, 0.05, 1.0], layout=["x", "y", "z"])
        await stage.operator.act("page", {"verb": "acquire"})
        with pytest.raises(BadProblemError, match=r"y is 0\.1 m: send -1 to 0\.05 m"):
            stage.operator.move("page", place(AIM))

    assert play(story).robot.sent == []


def test_an_entered_pose_is_not_sent_after_a_stop(play):
    async def story(stage: Stage) -> None:
        stage.robot.gets = False
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", place(AIM))
        await stage.until(lambda: len(stage.robot.sent) > 2)
        await stage.operator.act("page", {"verb": "stop"})
        while stage.operator._is_sending:
            await asyncio.sleep(0.0)

    stage = play(story)
    stop = stage.robot.done.index("stop")
    assert stage.robot.done[stop + 1 :].count("target") <= 1  # one that was on its way


@pytest.mark.parametrize("verb", ["stop", "recover"])
def test_an_entered_pose_is_held_where_a_stop_or_recovery_has_failed(play, verb):
    async def story(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", place(AIM))
        await stage.until(lambda: stage.robot.sent == [AIM])

        def fails() -> dict[str, Any]:
            raise LinkError("no answer")

        stage.source.stop = fails
        with pytest.raises((LinkError, UsageError)):
            await stage.operator.act("another page", {"verb": verb})
        if verb == "stop":
            await stage.until(lambda: stage.robot.sent[-1] != AIM)
        stage.operator.left("page")
        await stage.until(lambda: "release" in stage.robot.done)

    stage = play(story)
    assert stage.robot.sent[-1] != AIM


def test_a_page_that_was_silent_enters_no_pose_before_it_loses_its_role(play, monkeypatch):
    monkeypatch.setattr(operator, "SETTLE_S", PATIENCE_S)

    async def story(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.left("page", "is silent")
        with pytest.raises(UsageError, match="silent"):
            stage.operator.move("page", place(AIM))
        stage.operator._free()

    assert play(story).robot.sent == []


def test_an_entered_pose_is_held_though_a_question_is_lost(play):
    """One unanswered count ends nothing; a link that is lost ends the role, with a hold."""

    async def story(stage: Stage) -> None:
        whole = stage.robot.counts

        def counts() -> dict[str, Any]:
            if len(stage.robot.sent) < 3:
                raise LinkError("no answer")
            return whole()

        stage.robot.counts = counts
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", place(AIM))
        await stage.until(lambda: len(stage.robot.sent) == 3)
        assert stage.operator.says("page") == "me"
        stage.operator._give_up("a test")
        await stage.until(lambda: "release" in stage.robot.done)

    stage = play(story)
    assert stage.robot.sent[:3] == [AIM] * 3
    assert stage.robot.sent[-1] != AIM


def test_an_entered_pose_is_held_when_the_server_ends(play, monkeypatch):
    monkeypatch.setattr(operator, "HOLD_S", 0.3)

    async def story(stage: Stage) -> None:
        stage.robot.gets = False  # so that it is still being sent
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", place(AIM))
        await stage.until(lambda: len(stage.robot.sent) > 1)

    assert play(story).robot.sent[-1] != AIM


def test_a_page_that_is_silent_is_held_and_then_steers_no_longer(play, monkeypatch):
    monkeypatch.setattr(motion, "SILENT_S", PATIENCE_S)

    async def story(stage: Stage) -> None:
        await stage.drag_to_aim()
        monkeypatch.setattr(motion, "SILENT_S", 0.03)
        monkeypatch.setattr(motion, "LEASE_S", 0.1)
        await stage.until(lambda: "release" in stage.robot.done)

    stage = play(story)
    assert stage.robot.sent[0] == AIM
    assert len(stage.robot.sent) == 2
    assert "silent" in stage.told[-1]["label"]


def test_a_drop_that_is_followed_by_a_release_is_held(play):
    async def story(stage: Stage) -> None:
        await stage.drag_to_aim()
        stage.operator.move("page", {"verb": "drop"})
        await stage.operator.act("page", {"verb": "release"})

    stage = play(story)
    assert stage.robot.done[:4] == ["acquire", "target", "target", "release"]


def test_one_page_steers_at_a_time(play):
    async def story(stage: Stage) -> None:
        act, move = stage.operator.act, stage.operator.move
        with pytest.raises(UsageError):
            move("first", drag(AIM))
        await act("first", {"verb": "acquire"})
        assert (stage.operator.says("first"), stage.operator.says("second")) == ("me", "other")
        with pytest.raises(UsageError):
            await act("second", {"verb": "acquire"})
        with pytest.raises(UsageError):
            move("second", drag(AIM))
        with pytest.raises(UsageError):
            await act("second", {"verb": "release"})
        stage.operator.left("second")
        await act("first", {"verb": "release"})
        await act("second", {"verb": "acquire"})

    assert not play(story).robot.sent


def test_a_stop_waits_for_nothing_else_that_was_asked_for(play):
    async def story(stage: Stage) -> None:
        change = await stage.begin("page", verb="change", what={"gamma": 1.0})
        await stage.operator.act("other", {"verb": "stop"})
        assert stage.robot.done == ["stop"]
        stage.robot.let.set()
        await change

    play(story)


def test_a_page_that_goes_while_it_becomes_operator_leaves_nobody_operator(play):
    async def story(stage: Stage) -> None:
        asking = await stage.begin("page", verb="acquire")
        asking.cancel()
        stage.operator.left("page")
        await asyncio.gather(asking, return_exceptions=True)
        stage.robot.let.set()
        await stage.until(lambda: "release" in stage.robot.done)
        assert stage.operator.says("page") == "none"

    stage = play(story)
    assert stage.robot.done[:2] == ["acquire", "release"]


def test_a_lease_that_is_lost_is_told(play):
    async def story(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "acquire"})
        stage.robot.lost = "no controller answers"
        stage.operator.move("page", drag(AIM))
        while stage.operator.says("page") == "me":
            await asyncio.sleep(0)

    stage = play(story)
    assert "no controller answers" in stage.told[-1]["label"]
    assert not stage.robot.sent


def test_what_is_refused_says_why(play):
    async def story(stage: Stage) -> None:
        for verb in ("dance", "change", "recover", "release"):
            with pytest.raises(UsageError):
                await stage.operator.act("page", {"verb": verb, "what": 3})

    play(story)


def test_its_end_holds_what_moves(play):
    async def story(stage: Stage) -> None:
        await stage.drag_to_aim()

    stage = play(story)
    assert len(stage.robot.sent) == 2
    assert stage.robot.done[-1] == "close"


def test_a_stop_needs_no_second_session_and_waits_for_no_recovery(play):
    async def story(stage: Stage) -> None:
        recovery = await stage.begin("page", verb="recover")
        opened = stage.opened
        await stage.operator.act("page", {"verb": "stop"})
        assert stage.opened == opened
        assert stage.robot.done == ["stop"]
        stage.robot.recovers = True
        stage.robot.let.set()
        assert await recovery == {}

    async def first(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "stop"})
        assert stage.robot.done == ["stop"]
        assert not stage.opened

    play(story)
    play(first)


def test_a_stop_is_asked_for_also_where_its_page_goes_before(play):
    async def story(stage: Stage) -> None:
        busy, let = threading.Event(), threading.Event()

        def slow() -> dict[str, Any]:
            busy.set()
            assert let.wait(PATIENCE_S)
            return stage.robot.stop()

        stage.source.stop = slow
        first = asyncio.create_task(stage.operator.act("other", {"verb": "stop"}))
        await asyncio.to_thread(busy.wait, PATIENCE_S)
        second = asyncio.create_task(stage.operator.act("page", {"verb": "stop"}))
        await asyncio.sleep(0)  # it has been asked for, and waits for the first
        second.cancel()
        await asyncio.gather(second, return_exceptions=True)
        let.set()
        await first

    stage = play(story)
    assert [each for each in stage.robot.done if each == "stop"] == ["stop", "stop"]


def test_who_loses_the_robot_while_it_drags_gives_the_lease_back(play):
    """As after a stop: targets are refused, because the robot follows nobody."""

    async def story(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "acquire"})
        await stage.operator.act("page", {"verb": "stop"})
        stage.robot.lost = "it does not follow its controller now"
        stage.operator.move("page", drag(AIM))
        await stage.until(lambda: "release" in stage.robot.done)
        assert stage.operator.says("page") == "none"
        await stage.operator.act("next", {"verb": "acquire"})

    stage = play(story)
    assert "does not follow" in stage.told[-1]["label"]


def test_whatever_fails_while_it_steers_ends_the_steering_alone(play, monkeypatch):
    async def story(stage: Stage) -> None:
        await stage.operator.act("page", {"verb": "acquire"})

        def fails(*_: object) -> None:
            raise ValueError("zip() argument 2 is shorter than argument 1")

        with monkeypatch.context() as broken:
            broken.setattr(stage.operator._motion, "step", fails)
            await stage.until(lambda: "release" in stage.robot.done)
        assert stage.operator.says("page") == "none"
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", drag(AIM))
        await stage.until(lambda: AIM in stage.robot.sent)

    stage = play(story)
    assert "shorter" in stage.told[0]["label"]


def test_a_controller_with_other_targets_while_a_page_drives_ends_nothing(play):
    async def story(stage: Stage) -> None:
        drive = {"verb": "velocity", "name": "hand", "values": [0.1, 0, 0]}
        await stage.operator.act("page", {"verb": "acquire"})
        stage.operator.move("page", drive)
        await stage.until(lambda: "target" in stage.robot.done)
        stage.operator.move("page", drive)
        stage.source.frames = Frames(UR5, Looks({}), {})
        for _ in range(3):
            await asyncio.sleep(operator.TICK_S)
        with pytest.raises(UsageError):
            stage.operator.move("page", drag(AIM))
        assert stage.operator.says("page") == "me"

    assert not play(story).told
