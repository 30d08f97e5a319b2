"""The link on virtual time: order of arrivals, and the fates of answers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.runtime.clock import VirtualClock


def test_an_answer_arrives_after_the_compute_time():
    clock = VirtualClock(1000)
    link = LockstepLink(lambda state: b"answer to " + state, clock, compute_time=200)
    link.publish(b"1")
    clock.advance(199)
    assert link.drain() == []
    clock.advance(1)
    assert link.drain() == [(1200, b"answer to 1")]
    assert link.drain() == []


def test_the_stamp_is_the_arrival_however_late_it_is_drained():
    clock = VirtualClock()
    link = LockstepLink(lambda state: state, clock)
    link.publish(b"1")
    clock.advance(10**9)
    assert link.drain() == [(200_000, b"1")]


@given(
    delays=st.lists(st.lists(st.integers(0, 50), max_size=3), max_size=30),
    drains=st.sets(st.integers(0, 30)),
)
def test_whatever_the_fates_each_arrives_once_in_order_and_not_before_its_time(delays, drains):
    clock = VirtualClock()
    fates = iter(delays)
    link = LockstepLink(
        lambda state: state,
        clock,
        fate=lambda answer: [(delay, answer + b".%d" % k) for k, delay in enumerate(next(fates))],
    )
    expected, found = [], []
    for tick, each in enumerate(delays):
        clock.sleep_until(10 * tick)
        expected += [
            (10 * tick + delay, tick, k, b"%d.%d" % (tick, k)) for k, delay in enumerate(each)
        ]
        if tick in drains:
            drained = link.drain()
            assert all(stamp <= clock.now() for stamp, _ in drained)
            found += drained
        link.publish(b"%d" % tick)
    clock.advance(1000)
    found += link.drain()
    assert sorted(found) == sorted((stamp, payload) for stamp, *_, payload in expected)
    if not drains:
        assert found == [(stamp, payload) for stamp, *_, payload in sorted(expected)]


def test_requests_are_served_once_and_answered_to_who_asked():
    link = LockstepLink(lambda state: None, VirtualClock())
    answers = link.ask("acquire", "alice")
    link.ask("stop")
    first, second = link.requests()
    assert (first.verb, first.who) == ("acquire", "alice")
    assert (second.verb, second.who) == ("stop", "in process")
    first.answer({"granted": True})
    first.answer(b"bytes too")
    assert answers == [{"granted": True}, b"bytes too"]
    assert list(link.requests()) == []


def test_events_are_kept_for_whoever_looks():
    link = LockstepLink(lambda state: None, VirtualClock())
    link.announce(b"one")
    link.announce(b"two")
    link.close()
    assert link.announced == [b"one", b"two"]
