"""Which messages go to those who only look."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.link.zenoh_link import SAMPLED_TICKS, Sampling
from hoap3.protocol.messages import Setpoint, State


def state(tick: int, mode: int = State.IDLE) -> bytes:
    message = State.allocate(q=2)
    message.tick, message.mode = tick, mode
    return message.dump()


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60))
def test_each_span_of_ticks_gives_its_first_state_however_many_are_skipped(steps):
    ticks = [sum(steps[: i + 1]) for i in range(len(steps))]
    sampling = Sampling()
    taken = [tick for tick in ticks if sampling.takes(state(tick))]
    spans = [tick // SAMPLED_TICKS for tick in taken]
    assert spans == sorted(set(spans)) == sorted({tick // SAMPLED_TICKS for tick in ticks})
    for tick, span in zip(taken, spans, strict=True):
        assert tick == min(each for each in ticks if each // SAMPLED_TICKS == span)


def test_a_change_of_mode_is_seen_at_its_tick():
    sampling = Sampling()
    modes = [State.IDLE] * 5 + [State.ACTIVE] * 4 + [State.STOPPING, State.STOPPED]
    taken = [tick for tick, mode in enumerate(modes) if sampling.takes(state(tick, mode))]
    assert taken == [0, 5, 9, 10]


def test_setpoints_are_taken_at_the_ticks_of_the_states_that_they_answer():
    states, setpoints, setpoint = Sampling(), Sampling(), Setpoint.allocate(values=2)
    for tick in range(100):
        setpoint.tick = tick
        assert states.takes(state(tick, State.ACTIVE)) == setpoints.takes(setpoint.dump())


def test_a_state_that_is_sent_again_is_not_taken_twice():
    sampling = Sampling()
    assert sampling.takes(state(32))
    assert not sampling.takes(state(32))
