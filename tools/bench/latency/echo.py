"""The floor under every link in Python: a bare TCP echo, placed and paced as robot and controller.

One process asks, at each tick of an absolute schedule, with as many bytes as a State has; another
answers with as many as a Setpoint has. There is no Zenoh, no loop and no log between them. Both
run beside the link, half a period later, so that whatever the machine does falls on both.
"""

from __future__ import annotations

import io
import os
import socket
import struct
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.clock import Clock, MonotonicClock
from hoap3.protocol.runtime.realtime import Ticker, prepare_process, schedule_start
from hoap3.tools.analysis.cycles import NEVER
from hoap3.tools.machine.processes import Child, die_with_parent, read_order, tcp_pair

Stamps = npt.NDArray[np.int64]

_TICK = struct.Struct("<q")  # the first bytes of a question, and of its answer
_PATIENCE_S = 30.0  # for what should take no time at all


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

    def between(self, begin: int, end: int) -> Exchanges:
        """The ticks that were to start at or after `begin` and before `end` [ns]."""
        part = (self.intended >= begin) & (self.intended < end)
        return Exchanges(self.intended[part], self.sent[part], self.arrival[part])

    @property
    def skipped(self) -> int:
        """Ticks that passed before the asking process woke."""
        return int(np.count_nonzero(self.sent == NEVER))

    @property
    def rtt(self) -> npt.NDArray[np.float64]:
        """From question to answer [ns], nan where either is missing."""
        known = (self.sent != NEVER) & (self.arrival != NEVER)
        return np.where(known, (self.arrival - self.sent).astype(float), np.nan)


def exchange(peer: TcpPeer, clock: Clock, ticks: int, period_ns: int, size: int) -> Exchanges:
    """Ask at each tick, answered or not: the schedule waits for nobody.

    It lies half a period beside that of a robot on this machine.

    Args:
        peer: who answers.
        clock: that paces and stamps.
        ticks: how many.
        period_ns: from one to the next.
        size: bytes of a question.
    """
    start = schedule_start(clock, period_ns) + period_ns // 2
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


class BareEcho:
    """Two processes that wait for `begin`; then one asks and the other answers, until `close`.

    Args:
        order: `ticks`, `period_ns`, and `sizes`, bytes of a question and of an answer.
        asks, answers: placement of both.
    """

    def __init__(
        self, order: dict[str, Any], asks: RealtimeSettings, answers: RealtimeSettings
    ) -> None:
        self._planned_s = order["ticks"] * order["period_ns"] * 1e-9
        near, far = tcp_pair(_PATIENCE_S)
        waits, self._go = os.pipe()
        self._children: list[Child] = []
        try:
            for side, end, realtime in (("answer", far, answers), ("ask", near, asks)):
                fds = [end.fileno(), waits]
                whole = {**order, "side": side, "fds": fds, "realtime": realtime}
                module = ["hoap3.tools.bench.latency.echo"]
                self._children.append(Child(module, whole, fds, stdout=subprocess.PIPE))
        except BaseException:
            self.close()
            raise
        finally:
            near.close()
            far.close()
            os.close(waits)

    def begin(self) -> None:
        """Let the one ask."""
        with suppress(BrokenPipeError):  # both have ended: `result` tells
            os.write(self._go, b"!")

    def result(self) -> Exchanges:
        """What was exchanged; waits until all ticks are over.

        Only now the one that asked hands over and ends, which would disturb a link that still runs.

        Raises:
            Hoap3Error: one of them did not do its part, or nobody called `begin`.
        """
        self._close_go()
        try:
            out, _ = self._children[-1].communicate(timeout=2 * self._planned_s + _PATIENCE_S)
        except subprocess.TimeoutExpired as error:
            raise Hoap3Error("the bare echo, which the link is compared with, hangs") from error
        if self._children[-1].returncode:
            raise Hoap3Error("the bare echo, which the link is compared with, did not come about")
        return Exchanges(*np.load(io.BytesIO(out), allow_pickle=False))

    def close(self) -> None:
        """End both, whatever they do."""
        self._close_go()
        for child in self._children:
            child.kill()
            child.communicate()

    def _close_go(self) -> None:
        if self._go >= 0:
            os.close(self._go)
            self._go = -1


def main() -> None:
    """Be one of the two; the order comes on standard input, stamps go to standard output."""
    die_with_parent()
    order = read_order()
    prepare_process(order["realtime"])
    question, answer = order["sizes"]
    connection, go = order["fds"]
    with socket.socket(fileno=connection) as stream:
        if order["side"] == "answer":
            _answer(stream, question, answer)
            return
        peer = TcpPeer(stream, answer)
        peer.send(bytearray(question))
        if peer.receive(MonotonicClock.now() + round(_PATIENCE_S * 1e9)) is None:
            raise Hoap3Error("the process that answers did not begin")
        if not os.read(go, 1):
            sys.exit(1)  # nobody wants it
        found = exchange(peer, MonotonicClock(), order["ticks"], order["period_ns"], question)
        while os.read(go, 1):  # until its end is closed
            pass
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
