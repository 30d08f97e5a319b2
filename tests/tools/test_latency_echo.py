"""The bare echo: it asks on schedule whatever happens, and nothing is hidden."""

from __future__ import annotations

import signal
import socket
import struct
import threading

import numpy as np
import pytest

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.clock import MonotonicClock, VirtualClock
from hoap3.tools.latency import echo
from hoap3.tools.latency.echo import START_DELAY_NS, TcpPeer, exchange, run_echo
from hoap3.tools.timing.tick_logs import NEVER
from hoap3.tools.timing.tick_metrics import percentiles, response

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
    assert found.intended.tolist() == [10**12 + START_DELAY_NS + k * MS for k in range(500)]
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


def test_warm_up_is_left_out():
    found, _ = ask(300, delays={10: 900 * US}, stalls={20: 5 * MS})
    warm = found.after(200)
    assert len(warm.rtt) == 100
    assert warm.skipped == 0
    assert warm.rtt.max() == 15 * US


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
        with pytest.raises(Hoap3Error, match="ended"):
            TcpPeer(near, 24).receive(MonotonicClock.now() + 10**10)


def test_two_processes_exchange_what_was_ordered():
    order = {"ticks": 200, "period_ns": MS, "sizes": (1000, 300)}
    found = run_echo(order, ORDINARY, ORDINARY)
    assert len(found.rtt) == 200
    assert np.diff(found.intended).tolist() == [MS] * 199
    asked = found.sent != NEVER
    assert asked.any()
    assert (found.sent >= found.intended)[asked].all()
    assert (found.arrival != NEVER).any()
    assert np.nanmin(found.rtt) > 0


def test_asking_begins_when_somebody_answers(monkeypatch):
    started, begin = [], echo.start_module

    def start_late(module, order, fds):
        """Stop the process that answers until the one that asks has been started."""
        child = begin(module, order, fds)
        if order["side"] == "answer":
            child.send_signal(signal.SIGSTOP)
        else:
            threading.Timer(1.0, started[0].send_signal, (signal.SIGCONT,)).start()
        started.append(child)
        return child

    monkeypatch.setattr(echo, "start_module", start_late)
    found = run_echo({"ticks": 100, "period_ns": MS, "sizes": (1000, 300)}, ORDINARY, ORDINARY)
    assert (found.arrival != NEVER).sum() >= (found.sent != NEVER).sum() - 50


def test_a_placement_that_cannot_be_had_does_not_hang():
    order = {"ticks": 5000, "period_ns": MS, "sizes": (4, 4)}  # too few bytes for a tick
    with pytest.raises(Hoap3Error, match="did not come about"):
        run_echo(order, ORDINARY, ORDINARY)
