"""The floor under every link in Python: a bare TCP echo, placed and paced as robot and controller.

One process asks, at each tick of an absolute schedule, with as many bytes as a State has; another
answers with as many as a Setpoint has. There is no Zenoh, no loop and no log between them.
"""

from __future__ import annotations

import io
import socket
import struct
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.clock import Clock, MonotonicClock
from hoap3.protocol.runtime.realtime import Ticker, prepare_process
from hoap3.tools.machine.processes import die_with_parent, read_order, start_module, tcp_pair
from hoap3.tools.timing.tick_logs import NEVER

Stamps = npt.NDArray[np.int64]

START_DELAY_NS = 10_000_000
_TICK = struct.Struct("<q")  # the first bytes of a question, and of its answer
_PATIENCE_S = 30.0  # for what should take no time at all


class Peer(Protocol):
    """Who answers."""

    def send(self, question: bytearray) -> None:
        """Send a question."""

    def receive(self, deadline: int) -> bytes | None:
        """The next answer, waited for until `deadline` [ns] at most; None where none came."""


@dataclass(frozen=True)
class Exchanges:
    """One entry for each tick of the schedule; stamps of one clock [ns].

    Attributes:
        intended: start of the tick.
        sent: when the question was sent; NEVER for skipped ticks.
        arrival: when its answer was there; NEVER where none came.
    """

    intended: Stamps
    sent: Stamps
    arrival: Stamps

    def after(self, warm_up: int) -> Exchanges:
        """Without the first so many ticks."""
        return Exchanges(*(stamps[warm_up:] for stamps in (self.intended, self.sent, self.arrival)))

    @property
    def skipped(self) -> int:
        """Ticks that passed before the asking process woke."""
        return int(np.count_nonzero(self.sent == NEVER))

    @property
    def rtt(self) -> npt.NDArray[np.float64]:
        """From question to answer [ns], nan where either is missing."""
        known = (self.sent != NEVER) & (self.arrival != NEVER)
        return np.where(known, (self.arrival - self.sent).astype(float), np.nan)


def exchange(peer: Peer, clock: Clock, ticks: int, period_ns: int, size: int) -> Exchanges:
    """Ask at each tick, answered or not: the schedule waits for nobody.

    Args:
        peer: who answers.
        clock: that paces and stamps.
        ticks: how many.
        period_ns: from one to the next.
        size: bytes of a question.
    """
    start = clock.now() + START_DELAY_NS
    ticker = Ticker(clock, period_ns, start)
    sent, arrival = np.full(ticks, NEVER), np.full(ticks, NEVER)
    question = bytearray(size)
    now, send, receive = clock.now, peer.send, peer.receive
    pack, unpack = _TICK.pack_into, _TICK.unpack_from
    unanswered = 0
    while ticker.tick < ticks - 1:
        ticker.wait()
        tick = ticker.tick
        if tick >= ticks:
            break
        pack(question, 0, tick)
        sent[tick] = now()
        send(question)
        unanswered += 1
        deadline = ticker.intended + period_ns
        while unanswered and (answer := receive(deadline)) is not None:
            stamp = now()
            arrival[unpack(answer)[0]] = stamp
            unanswered -= 1
    intended = start + period_ns * np.arange(ticks)
    return Exchanges(intended, sent, arrival)


class TcpPeer:
    """A peer at the other end of a connection; its answers have a fixed size."""

    def __init__(self, stream: socket.socket, size: int) -> None:
        self._stream, self._size = stream, size
        self._rest = b""
        self._now = MonotonicClock.now

    def send(self, question: bytearray) -> None:
        """Send a question."""
        self._stream.settimeout(_PATIENCE_S)
        self._stream.sendall(question)

    def receive(self, deadline: int) -> bytes | None:
        """The next answer, or None."""
        remaining = deadline - self._now()
        if remaining <= 0:
            return None
        stream, size = self._stream, self._size
        stream.settimeout(remaining * 1e-9)
        try:
            answer = self._rest + stream.recv(size - len(self._rest))
            while len(answer) < size:
                self._rest = answer
                piece = stream.recv(size - len(answer))
                if not piece:
                    raise Hoap3Error("the process that answers has ended")
                answer += piece
        except TimeoutError:
            return None
        self._rest = b""
        return answer


def run_echo(order: dict[str, Any], asks: RealtimeSettings, answers: RealtimeSettings) -> Exchanges:
    """Run one block with two processes.

    Args:
        order: `ticks`, `period_ns`, and `sizes`, bytes of a question and of an answer.
        asks, answers: placement of both.

    Raises:
        Hoap3Error: one of them did not do its part.
    """
    near, far = tcp_pair(_PATIENCE_S)
    children: list[subprocess.Popen[bytes]] = []
    try:
        for side, end, realtime in (("answer", far, answers), ("ask", near, asks)):
            fd = end.fileno()
            whole = {**order, "side": side, "fd": fd, "realtime": _plain(realtime)}
            children.append(start_module("hoap3.tools.latency.echo", whole, [fd]))
            end.close()
        planned = order["ticks"] * order["period_ns"] * 1e-9
        out, _ = children[-1].communicate(timeout=2 * planned + _PATIENCE_S)
        if children[-1].returncode:
            raise Hoap3Error("the bare echo, which the link is compared with, did not come about")
        return Exchanges(*np.load(io.BytesIO(out), allow_pickle=False))
    except subprocess.TimeoutExpired as error:
        raise Hoap3Error("the bare echo, which the link is compared with, hangs") from error
    finally:
        for child in children:
            child.kill()
            child.communicate()


def _plain(settings: RealtimeSettings) -> dict[str, Any]:
    return settings.model_dump(mode="json")


def main() -> None:
    """Be one of the two; the order comes on standard input, stamps go to standard output."""
    die_with_parent()
    order = read_order()
    prepare_process(RealtimeSettings(**order["realtime"]))
    question, answer = order["sizes"]
    with socket.socket(fileno=order["fd"]) as stream:
        if order["side"] == "answer":
            _answer(stream, question, answer)
            return
        peer = TcpPeer(stream, answer)
        peer.send(bytearray(question))
        if peer.receive(MonotonicClock.now() + round(_PATIENCE_S * 1e9)) is None:
            raise Hoap3Error("the process that answers did not begin")
        found = exchange(peer, MonotonicClock(), order["ticks"], order["period_ns"], question)
    np.save(sys.stdout.buffer, np.stack([found.intended, found.sent, found.arrival]))


def _answer(stream: socket.socket, question: int, answer: int) -> None:
    """Answer each question, until nobody asks any more."""
    reply, tick = bytearray(answer), _TICK.size
    while True:
        data = stream.recv(question, socket.MSG_WAITALL)
        if len(data) < question:
            return
        reply[:tick] = data[:tick]
        stream.sendall(reply)


if __name__ == "__main__":
    main()
