"""The bare echo: it asks on schedule whatever happens, and nothing is hidden."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import closing

import numpy as np
import pytest

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.clock import MonotonicClock, VirtualClock
from hoap3.protocol.runtime.realtime import START_DELAY_NS
from hoap3.tools.analysis.cycles import NEVER
from hoap3.tools.analysis.tick_metrics import percentiles, response
from hoap3.tools.bench.latency.echo import BareEcho, TcpPeer, exchange

MS, US = 1_000_000, 1_000
ORDINARY = RealtimeSettings(policy="none", cpu="none", lock_memory=False)


class VirtualPeer:
    """Answers after a given time, on virtual time.

    Args:
        delays: of each answer by tick [ns]; None for never.
        stalls: how long the asking process is held up after it has sent, by tick [ns].
    """

    def __init__(self, clock, delays=None, stalls=None):
        self.clock, self.delays, self.stalls = clock, delays or {}, stalls or {}
        self.flying, self.asked = [], []

    def send(self, question):
        (tick,) = struct.unpack_from("<q", question)
        self.asked.append(tick)
        delay = self.delays.get(tick, 15 * US)
        if delay is not None:
            self.flying.append((self.clock.now() + delay, bytes(question[:8])))
        self.clock.advance(self.stalls.get(tick, 0))

    def receive(self, deadline):
        self.flying.sort()
        if self.flying and self.flying[0][0] <= max(deadline, self.clock.now()):
            arrival, answer = self.flying.pop(0)
            self.clock.sleep_until(arrival)
            return answer
        self.clock.sleep_until(deadline)
        return None


def ask(ticks, **peer):
    clock = VirtualClock(10**12)
    peer = VirtualPeer(clock, **peer)
    return exchange(peer, clock, ticks, MS, 64), peer


def test_every_tick_is_asked_and_answered():
    found, peer = ask(500)
    assert peer.asked == list(range(500))
    assert found.rtt.tolist() == [15 * US] * 500
    half = 10**12 + START_DELAY_NS + MS // 2
    assert found.intended.tolist() == [half + k * MS for k in range(500)]
    assert np.array_equal(found.sent, found.intended)
    assert found.skipped == 0


def test_the_schedule_waits_for_no_answer():
    late = {100: 3 * MS + 200 * US, 200: None}
    found, peer = ask(500, delays=late)
    assert peer.asked == list(range(500))
    assert found.rtt[100] == late[100]
    assert found.arrival[200] == NEVER
    assert np.isnan(found.rtt[200])
    others = np.delete(found.rtt, [100, 103, 200])
    assert (others == 15 * US).all()


def test_a_sender_that_stalls_hides_nothing():
    found, _ = ask(1000, stalls={500: 50 * MS})
    closed = percentiles(found.rtt)
    assert closed["p99"] == 15.0  # what a sender sees that waits for itself
    assert found.skipped == 49
    open_loop = percentiles(response(found.intended, found.arrival, int(found.arrival.max())))
    ideal = np.full(1000, 15 * US)
    ideal[500:550] = np.maximum(50 * MS - MS * np.arange(50), 15 * US)  # the stall, tick by tick
    ideal[501:550] += 15 * US
    assert open_loop["n"] == 1000
    assert open_loop["p99"] == pytest.approx(np.percentile(ideal, 99) / 1e3, rel=0.03)
    assert open_loop["p99"] > 2000 * closed["p99"]


def test_a_part_has_the_ticks_between_begin_and_end():
    found, _ = ask(300, delays={10: 900 * US}, stalls={20: 5 * MS})
    part = found.between(found.intended[200], found.intended[250])
    assert part.intended.tolist() == found.intended[200:250].tolist()
    assert part.skipped == 0
    assert part.rtt.tolist() == [15 * US] * 50


def test_answers_in_pieces_are_put_together():
    near, far = socket.socketpair()
    with near, far:
        peer, clock = TcpPeer(near, 24), MonotonicClock()
        answers = [struct.pack("<qqq", tick, 1, 2) for tick in range(3)]
        far.sendall(answers[0][:5])
        assert peer.receive(clock.now() + MS) is None
        far.sendall(answers[0][5:] + answers[1] + answers[2][:23])
        found = [peer.receive(clock.now() + 10**10) for _ in range(2)]
        sender = threading.Thread(target=far.sendall, args=(answers[2][23:],))
        sender.start()
        found.append(peer.receive(clock.now() + 10**10))
        sender.join()
        assert found == answers
        assert peer.receive(clock.now() - 1) is None


def test_a_peer_that_is_gone_is_told():
    near, far = socket.socketpair()
    with near:
        far.close()
        with pytest.raises(Hoap3Error):
            TcpPeer(near, 24).receive(MonotonicClock.now() + 10**10)


def test_two_processes_exchange_what_was_ordered_half_a_period_beside_a_robot():
    order = {"ticks": 200, "period_ns": MS, "sizes": (1000, 300)}
    with closing(BareEcho(order, ORDINARY, ORDINARY)) as echo:
        before = MonotonicClock.now()
        echo.begin()
        found = echo.result()
    assert len(found.rtt) == 200
    assert found.intended[0] > before
    assert found.intended[0] % MS == MS // 2
    assert np.diff(found.intended).tolist() == [MS] * 199
    asked = found.sent != NEVER
    assert asked.any()
    assert (found.sent >= found.intended)[asked].all()
    assert (found.arrival != NEVER).any()
    assert np.nanmin(found.rtt) > 0


def test_an_echo_that_nobody_began_ends_with_an_error():
    order = {"ticks": 200, "period_ns": MS, "sizes": (1000, 300)}
    with (
        closing(BareEcho(order, ORDINARY, ORDINARY)) as echo,
        pytest.raises(Hoap3Error),
    ):
        echo.result()


def test_a_placement_that_cannot_be_had_does_not_hang():
    order = {"ticks": 5000, "period_ns": MS, "sizes": (4, 4)}  # too few bytes for a tick
    with closing(BareEcho(order, ORDINARY, ORDINARY)) as echo:
        echo.begin()
        with pytest.raises(Hoap3Error):
            echo.result()
