"""The controller's cycle on a virtual clock: what it answers, and what it records."""

from __future__ import annotations

import json

import numpy as np
import pytest
from loop_bench import SESSION, Bench, Wanderer
from support.small_arm import arm

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.link.base import Request
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.claim import MOST_STRANGE_STATES
from hoap3.remote_controller.loop import LONGEST_CHANGE, ControllerLoop
from hoap3.remote_controller.service import rehearse, serve


def test_an_answer_belongs_to_its_state():
    bench = Bench(epoch=3)
    setpoint = bench.setpoint(bench.state(5, epoch=3))
    assert (setpoint.session_id, setpoint.tick, setpoint.epoch) == (SESSION, 5, 3)
    assert setpoint.stamp_state == 5_000_050
    np.testing.assert_array_equal(setpoint.values, np.full(3, 0.5) + 1e-3)
    assert bench.loop.answered == 1


def test_a_repeated_tick_is_answered_with_the_bytes_already_sent():
    bench = Bench()
    first = bench.answer(bench.state(5))
    bench.clock.advance(50_000_000)
    assert bench.answer(bench.state(5)) == first
    assert bench.controller.steps == [5]
    assert (bench.loop.repeated, bench.loop.answered) == (1, 1)
    assert len(bench.recorded(Kind.STATE)) == len(bench.recorded(Kind.SETPOINT)) == 1


def test_an_older_tick_is_not_answered():
    bench = Bench()
    for tick in (5, 6):
        bench.answer(bench.state(tick))
    assert bench.answer(bench.state(5)) is None
    assert bench.controller.steps == [5, 6]
    assert bench.loop.repeated == 1
    assert bench.answer(bench.state(7)) is not None


def test_states_of_another_session_alone_make_the_loop_stale():
    bench = Bench()
    bench.answer(bench.state(5))
    for tick in range(6, 6 + MOST_STRANGE_STATES):
        assert not bench.loop.stale
        assert bench.answer(bench.state(tick, session_id=8)) is None
    assert bench.loop.stale
    assert bench.controller.steps == [5]
    assert bench.loop.ignored().startswith(f"{MOST_STRANGE_STATES} ")


def test_states_of_another_robot_of_the_name_between_those_of_ours_do_not():
    bench = Bench()
    for tick in range(5, 5 + 2 * MOST_STRANGE_STATES):
        bench.answer(bench.state(tick))
        assert bench.answer(bench.state(tick, session_id=8)) is None
    assert not bench.loop.stale


def test_ticks_that_stay_behind_a_forged_one_make_the_loop_stale():
    bench = Bench()
    bench.answer(bench.state(5))
    bench.answer(bench.state(1 << 40))
    for tick in range(6, 6 + MOST_STRANGE_STATES - 1):
        assert bench.answer(bench.state(tick)) is None
        assert not bench.loop.stale
    bench.answer(bench.state(6 + MOST_STRANGE_STATES))
    assert bench.loop.stale


@pytest.mark.parametrize("changes", [{"epoch": 0, "mode": State.IDLE}, {"epoch": 2}])
def test_a_robot_that_follows_us_no_longer_makes_the_loop_stale(changes):
    bench = Bench()
    bench.answer(bench.state(5))
    for tick in range(6, 6 + MOST_STRANGE_STATES - 1):
        bench.answer(bench.state(tick, **changes))
        assert not bench.loop.stale
    bench.answer(bench.state(6 + MOST_STRANGE_STATES, **changes))
    assert bench.loop.stale


def test_a_robot_that_stands_still_for_us_is_waited_for():
    bench = Bench()
    for tick in range(5, 5 + 3 * MOST_STRANGE_STATES):
        bench.answer(bench.state(tick, epoch=0, epoch_from_tick=5, mode=State.STOPPED))
    assert not bench.loop.stale


def test_a_robot_that_comes_to_rest_from_an_earlier_grant_is_waited_for():
    """We asked while it braked for the one before: it follows that epoch until it is at rest."""
    bench = Bench(epoch=3)
    for tick in range(5, 5 + 3 * MOST_STRANGE_STATES):
        bench.answer(bench.state(tick, epoch=2, epoch_from_tick=400, mode=State.STOPPING))
    assert not bench.loop.stale


def test_states_that_never_came_are_counted():
    bench = Bench()
    for tick in (100, 101, 105, 106, 116):  # what came before it joined is not missing
        bench.answer(bench.state(tick))
    assert bench.loop.overwritten == 3 + 9
    assert bench.controller.steps == [100, 101, 105, 106, 116]


def test_bytes_that_are_no_state_are_counted_and_not_answered():
    bench = Bench()
    good = bench.state(5)
    version = bytearray(good)
    version[4] += 1
    for payload in (b"", good[:-1], good + b"\0", Setpoint(3).dump(), State(4).dump(), version):
        assert bench.answer(bytes(payload)) is None
    assert bench.loop.rejected == 6
    assert not bench.controller.steps
    assert bench.answer(good) is not None


def test_without_authority_it_follows_in_silence():
    bench = Bench(epoch=0)
    assert [bench.answer(bench.state(tick, epoch=0)) for tick in range(3)] == [None] * 3
    assert [bench.answer(bench.state(tick)) for tick in range(3, 6)] == [None] * 3  # another's
    assert bench.controller.steps == list(range(6))
    assert bench.answer(bench.state(5)) is None  # and what was not answered is not repeated
    assert bench.loop.answered == 0
    assert not bench.recorded(Kind.SETPOINT)
    assert len(bench.recorded(Kind.STATE)) == 6


@pytest.mark.parametrize("mode", [State.IDLE, State.STOPPING, State.STOPPED])
def test_a_robot_that_is_not_active_is_not_answered(mode):
    bench = Bench()
    assert bench.answer(bench.state(0, mode=mode)) is None
    assert bench.controller.steps == [0]


def test_stamps_follow_the_cycle():
    bench = Bench()
    first, second = bench.setpoint(bench.state(1)), bench.setpoint(bench.state(2))
    assert first.stamp_sent_previous == 0
    # the clock is lockstep's: it goes to when the State was published, 120 ns pass in the step
    for setpoint, published in ((first, 1_000_050), (second, 2_000_050)):
        assert setpoint.stamp_received == setpoint.stamp_decoded == published
        assert setpoint.stamp_kinematics == published + 100
        assert setpoint.stamp_solved == setpoint.stamp_encoded == published + 120
    assert second.stamp_sent_previous == first.stamp_encoded + 7


def test_in_real_time_stamps_are_the_arrival_and_the_clocks():
    class Real:
        time = 10_000

        def now(self) -> int:
            self.time += 1
            return self.time

        def sleep_until(self, deadline: int) -> None:
            raise AssertionError("a controller has no timer")

    bench = Bench()
    clock = Real()
    loop = ControllerLoop(bench.controller, clock, bench.recorder, SESSION)
    loop.grant(1)
    answer = loop.answer(9_000, bench.state(1))
    loop.sent()
    setpoint = Setpoint(3)
    setpoint.load(answer)
    stamps = [
        setpoint.stamp_received,
        setpoint.stamp_decoded,
        setpoint.stamp_kinematics,
        setpoint.stamp_solved,
        setpoint.stamp_encoded,
    ]
    assert stamps[0] == 9_000
    assert stamps == sorted(set(stamps))


def test_it_records_in_the_order_in_which_it_processed():
    bench = Bench(epoch=0)
    bench.loop.begin(arm(), lockstep=True)
    bench.loop.grant(1)
    bench.answer(bench.state(0))
    bench.answer(bench.state(1))
    kinds = [record.kind for record in bench.recorder.records]
    assert kinds == [
        Kind.DESCRIPTION,
        Kind.SESSION,
        Kind.AUTHORITY,
        Kind.STATE,
        Kind.EVENT,
        Kind.RESET,
        Kind.SETPOINT,
        Kind.STATE,
        Kind.SETPOINT,
    ]
    assert json.loads(bench.recorded(Kind.AUTHORITY)[0]) == {"epoch": 1}
    assert json.loads(bench.recorded(Kind.SESSION)[0])["session_id"] == SESSION
    assert bench.recorded(Kind.STATE)[0] == bench.state(0)
    stamps = [record.stamp for record in bench.recorder.records]
    assert stamps == sorted(stamps)


def test_nothing_is_recorded_before_the_answer_is_on_its_way():
    bench = Bench()
    before = len(bench.recorder.records)
    bench.loop.answer(0, bench.state(0))
    assert len(bench.recorder.records) == before
    bench.loop.sent()
    assert len(bench.recorder.records) == before + 4


def test_the_controller_gets_the_clock_of_the_loop():
    bench = Bench()
    assert bench.controller.now() == bench.clock.now()


def test_a_change_is_recorded_between_the_steps_where_it_came():
    bench = Bench()
    bench.answer(bench.state(0))
    bench.loop.change(b'{"pace": 2}')
    bench.answer(bench.state(1))
    assert bench.controller.told == [{"pace": 2}]
    assert bench.recorded(Kind.CHANGE) == [b'{"pace": 2}']
    kinds = [record.kind for record in bench.recorder.records]
    assert kinds[-5:] == [Kind.SETPOINT, Kind.CHANGE, Kind.EVENT, Kind.STATE, Kind.SETPOINT]


@pytest.mark.parametrize(
    "request_",
    [
        b"",
        b"[1]",
        b"\xff",
        b'{"pace": 0}',
        b"[" * LONGEST_CHANGE,  # deeper than json recurses
        b'{"pace": "' + b"x" * LONGEST_CHANGE + b'"}',
    ],
    ids=["nothing", "list", "bytes", "refused", "deep", "long"],
)
def test_a_change_that_is_refused_leaves_no_trace(request_):
    bench = Bench()
    bench.answer(bench.state(0))
    with pytest.raises(UsageError):
        bench.loop.change(request_)
    assert bench.controller.told == []
    assert bench.recorded(Kind.CHANGE) == []


def test_a_change_is_refused_while_the_robot_does_not_follow():
    bench = Bench()
    with pytest.raises(UsageError, match="hoap3 recover"):
        bench.loop.change(b'{"pace": 2}')
    bench.answer(bench.state(0))
    bench.loop.change(b'{"pace": 3}')
    bench.answer(bench.state(1, mode=State.STOPPED))
    with pytest.raises(UsageError, match="hoap3 recover"):
        bench.loop.change(b'{"pace": 4}')
    assert bench.controller.told == [{"pace": 3}]


def test_what_can_be_changed_is_json_or_a_clear_failure():
    bench = Bench()
    assert bench.loop.changeable() == {"pace": 1}
    bench.controller.pace = np.zeros(3)
    with pytest.raises(Hoap3Error, match="Wanderer"):
        bench.loop.changeable()


def test_what_a_controller_is_is_told_once_and_then_costs_it_nothing():
    bench, answers = Bench(), []
    about = bench.loop.about(b'{"gamma": 0.5}')
    told = json.loads(about)
    assert told["error"] is None
    assert told["now"]["config"] == {"gamma": 0.5}
    assert told["now"]["extra"] == list(bench.controller.extra_names)
    bench.controller.numbers = pytest.fail  # nobody asks it again
    serve(Request("about", "somebody", answers.append), bench.loop, about)
    assert answers == [about]


@pytest.mark.parametrize("name", [b"bytes", 1j, np.zeros(2)], ids=["bytes", "complex", "array"])
def test_a_controller_that_is_no_json_is_a_clear_failure_before_it_answers_anything(name):
    bench = Bench()
    bench.controller.extra_names = (name,)
    with pytest.raises(Hoap3Error, match="Wanderer"):
        bench.loop.about()


class Elsewhere(Wanderer):
    """Sets `values` to an array of its own, of which nothing would travel."""

    def step(self, state: State) -> Setpoint:
        self.command.values = state.reference + 1e-3
        return self.command


class Another(Wanderer):
    """Returns a message of its own."""

    def step(self, state: State) -> Setpoint:
        super().step(state)
        return Setpoint(3)


class Forgetful(Wanderer):
    """Returns nothing."""

    def step(self, state: State) -> Setpoint:
        super().step(state)
        return None  # type: ignore[return-value]


class Replaced(Wanderer):
    """Sets another array of the message to one of its own."""

    def step(self, state: State) -> Setpoint:
        self.command.extra = np.zeros(0)
        return super().step(state)


@pytest.mark.parametrize("kind", [Elsewhere, Another, Forgetful, Replaced])
def test_an_answer_that_is_not_what_would_travel_is_refused_at_once(kind):
    bench = Bench()
    loop = ControllerLoop(kind(bench.clock), bench.clock, bench.recorder, SESSION)
    loop.grant(1)
    with pytest.raises(UsageError, match=rf"{kind.__name__}\.step.*values\[:\]"):
        loop.answer(bench.clock.now(), bench.state(5))
    with pytest.raises(Hoap3Error, match=kind.__name__):
        rehearse(kind(bench.clock), arm())


@pytest.mark.parametrize("field", ["q", "reference", "tick"])
def test_a_controller_that_changes_the_state_is_refused_at_once(field):
    class Intruder(Wanderer):
        def step(self, state: State) -> Setpoint:
            if field == "tick":
                state.tick = 99
            else:
                getattr(state, field)[:] = 99.0
            return super().step(state)

    bench = Bench()
    loop = ControllerLoop(Intruder(bench.clock), bench.clock, bench.recorder, SESSION)
    loop.grant(1)
    with pytest.raises(UsageError, match=r"Intruder\.step"):
        loop.answer(bench.clock.now(), bench.state(5))


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_the_first_answer_that_is_not_finite_is_described(value):
    class Broken(Wanderer):
        def step(self, state: State) -> Setpoint:
            super().step(state)
            if state.tick > 5:
                self.command.values[1:] = value
            return self.command

    bench = Bench()
    bench.loop = ControllerLoop(Broken(bench.clock), bench.clock, bench.recorder, SESSION)
    bench.loop.grant(1)
    bench.answer(bench.state(5))
    assert bench.loop.not_finite == ""
    for tick in (6, 7):
        bench.answer(bench.state(tick))
        for words in ("Broken", "tick 6", "values[1]", arm().joint_names[1], str(value)):
            assert words in bench.loop.not_finite


def test_a_refusal_is_no_mistake_of_the_controller():
    class Refusing(Wanderer):
        def step(self, state: State) -> Setpoint:
            return self.refuse(0)

    bench = Bench()
    bench.loop = ControllerLoop(Refusing(bench.clock), bench.clock, bench.recorder, SESSION)
    bench.loop.grant(1)
    assert np.isnan(bench.setpoint(bench.state(5)).values).all()
    assert bench.loop.not_finite == ""
