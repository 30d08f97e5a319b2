"""One CPU for both sides, or two? Measured with two bare processes that exchange a byte.

The answers come over loopback TCP, paced like a robot's ticks. Both placements take turns, a few
exchanges each, so that whatever the machine does meanwhile falls on both alike. What is measured
is the way there and back alone: no Zenoh, no controller.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from protocol.clock import Clock, MonotonicClock
from protocol.realtime import CpuClaim, Ticker, claim_cpu, prepare_process
from protocol.settings import RealtimeSettings
from protocol.statistics import Durations
from tools.awake import kept_awake
from tools.placement import waking_is_dear
from tools.processes import die_with_parent, start_module, tcp_pair

PERIOD_NS = 1_000_000
EXCHANGES = 1000  # of each placement
TURN = 20  # exchanges until it is the other placement's turn
WORTH_US = 20.0
"""RTT that a second CPU may cost: it lets tick and computation overlap, 2 % of a period is fair."""

_TIMEOUT_S = 5.0  # without an answer, or beyond the time that everything should take

Exchange = Callable[[], None]


@dataclass(frozen=True)
class Order:
    """What is to be measured.

    Attributes:
        cpu: of the process that asks.
        echoes: CPU of the process that answers, by placement.
        exchanges: of each placement.
        period_ns: from one to the next.
        policy: "auto" or "none", as `realtime.policy`.
    """

    cpu: int
    echoes: Mapping[str, int]
    exchanges: int = EXCHANGES
    period_ns: int = PERIOD_NS
    policy: str = "auto"


Runner = Callable[[Order], dict[str, Any]]
"""Carries an order out: figures as `Timing.summary` has them, and `rights`, what was granted."""


class Timing:
    """Round trips of each placement, and the wake-ups between them."""

    def __init__(self, names: Mapping[str, object]) -> None:
        self.rtt = {name: Durations() for name in names}
        self.wakeup = Durations()
        self.skipped = 0

    def summary(self) -> dict[str, Any]:
        """Figures [us] by name."""
        return {
            "rtt_us": {name: durations.summary() for name, durations in self.rtt.items()},
            "wakeup_us": self.wakeup.summary(),
            "skipped": self.skipped,
        }


def time_exchanges(
    peers: Mapping[str, Exchange], clock: Clock, exchanges: int, period_ns: int
) -> Timing:
    """Exchange something with each peer in turn, once a period.

    The first turn of each is for warming up and enters no figure.

    Args:
        peers: blocks until the answer is there, by placement.
        clock: that paces and measures.
        exchanges: of each placement.
        period_ns: from one to the next.
    """
    timing = Timing(peers)
    ticker = Ticker(clock, period_ns, clock.now() + period_ns)
    warm_up = TURN * len(peers)
    rounds = 1 + -(-exchanges // TURN)
    plan = [name for _ in range(rounds) for name in peers for _ in range(TURN)]
    for count, name in enumerate(plan):
        ticker.wait()
        sent = clock.now()
        peers[name]()
        rtt = clock.now() - sent
        if count >= warm_up and timing.rtt[name].n < exchanges:
            timing.rtt[name].add(rtt, ticker.tick)
            timing.wakeup.add(ticker.actual - ticker.intended, ticker.tick)
            timing.skipped += ticker.skipped
    return timing


def measure_placement(
    runner: Runner | None = None,
    *,
    claim: Callable[[], CpuClaim | None] = claim_cpu,
    dear: bool | None = None,
    exchanges: int = EXCHANGES,
    policy: str = "auto",
) -> dict[str, Any]:
    """Measure both placements on CPUs that no run has claimed, and choose between them.

    Args:
        runner: carries the order out; by default processes do.
        claim: gives a CPU that is ours for as long as this takes.
        dear: whether waking another CPU takes so long that `hoap3 run` takes one for both sides;
            where it does not, the CPUs are kept awake meanwhile, as there.
        exchanges: of each placement.
        policy: "auto" asks for real-time priority, "none" does not.

    Returns:
        `measured`; where it is true, figures of `one_cpu` and, with two CPUs, of `two_cpus`,
        `rights`, `wakeup_us`, `skipped`, and what `recommend` says; else only `why`.
    """
    claims = [claimed for _ in range(2) if (claimed := claim()) is not None]
    if not claims:
        return {"measured": False, "why": "every allowed CPU is claimed by a run"}
    cpus = [claimed.cpu for claimed in claims]
    echoes = dict(zip(("one_cpu", "two_cpus"), cpus, strict=False))
    dear = waking_is_dear(RealtimeSettings()) if dear is None else dear
    try:
        with ExitStack() as awake:
            for cpu in () if dear else cpus:
                awake.enter_context(kept_awake(cpu))
            figures = (runner or run_processes)(Order(cpus[0], echoes, exchanges, policy=policy))
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        return {"measured": False, "why": f"the processes gave no figures: {error}"}
    finally:
        for claimed in claims:
            claimed.release()
    rtt = figures.pop("rtt_us")
    return {
        "measured": True,
        **figures,
        **{
            name: {"cpus": sorted({cpus[0], echo}), "rtt_us": rtt[name]}
            for name, echo in echoes.items()
        },
        **recommend(rtt, cpus, dear),
    }


def recommend(
    rtt: Mapping[str, Mapping[str, Any]], cpus: Sequence[int], dear: bool
) -> dict[str, Any]:
    """Choose a placement.

    Args:
        rtt: figures [us] by placement.
        cpus: that the robot and its controller would have, if they have one each.
        dear: whether `hoap3 run` takes one CPU for both by itself, or two.

    Returns:
        `recommended`, a placement, and `why`; `realtime_cpu`, the setting `realtime.cpu` of both
        sides that brings it about; `run_does_it`, whether `hoap3 run` does without a setting.
    """
    choice, why = "one_cpu", "no second CPU is free"
    if "two_cpus" in rtt:
        dearer = rtt["two_cpus"]["p50"] - rtt["one_cpu"]["p50"]
        why = f"waking another CPU costs {dearer:.0f} us more of each round trip"
        if dearer <= WORTH_US:
            choice = "two_cpus"
            why = (
                f"waking another CPU costs {max(dearer, 0.0):.0f} us, and a tick waits for no solve"
            )
    robot = cpus[0] if choice == "one_cpu" else cpus[1]
    return {
        "recommended": choice,
        "why": why,
        "realtime_cpu": {"emulator": robot, "controller": cpus[0]},
        "run_does_it": len(cpus) == 1 or dear == (choice == "one_cpu"),
    }


def run_processes(order: Order) -> dict[str, Any]:
    """Carry an order out with a process that asks and one that answers for each placement.

    Raises:
        OSError, ValueError, subprocess.SubprocessError: a process did not do its part.
    """
    ends = {name: tcp_pair(_TIMEOUT_S) for name in order.echoes}
    settings = {"policy": order.policy, "lock_memory": False}
    children: list[subprocess.Popen[bytes]] = []
    try:
        for name, cpu in order.echoes.items():
            fds = {name: ends[name][1].fileno()}
            children.append(_start(fds, {"echo": fds, "realtime": {**settings, "cpu": cpu}}))
        fds = {name: pair[0].fileno() for name, pair in ends.items()}
        children.append(
            _start(
                fds,
                {
                    "ask": fds,
                    "realtime": {**settings, "cpu": order.cpu},
                    "exchanges": order.exchanges,
                    "period_ns": order.period_ns,
                },
            )
        )
        for pair in ends.values():
            for end in pair:
                end.close()  # ours: who answers shall see the end of who asks
        planned = (order.exchanges + TURN) * len(order.echoes) * order.period_ns * 1e-9
        out, errors = children[-1].communicate(timeout=2 * planned + 2 * _TIMEOUT_S)
        if children[-1].returncode:
            raise ValueError(errors.decode(errors="replace").strip().rpartition("\n")[2])
        figures: dict[str, Any] = json.loads(out)
        return figures
    finally:
        for child in children:
            child.kill()
            child.communicate()


def _start(fds: Mapping[str, int], order: dict[str, Any]) -> subprocess.Popen[bytes]:
    ends = list(fds.values())
    return start_module("tools.doctor_placement", order, ends, stderr=subprocess.PIPE)


def main() -> None:
    """Be one of the processes; the order comes on standard input, figures go to standard output."""
    die_with_parent()
    order = json.load(sys.stdin)
    settings = RealtimeSettings(**order["realtime"])
    granted = {measure.name: measure for measure in prepare_process(settings)}
    if not granted["CPU"].obtained:
        sys.exit(str(granted["CPU"]))
    fds = order.get("echo") or order["ask"]
    streams = {name: socket.socket(fileno=fd) for name, fd in fds.items()}
    if "echo" in order:
        for stream in streams.values():
            while data := stream.recv(1):
                stream.sendall(data)
        return
    for stream in streams.values():
        stream.settimeout(_TIMEOUT_S)
    peers = {name: _asker(stream) for name, stream in streams.items()}
    timing = time_exchanges(peers, MonotonicClock(), order["exchanges"], order["period_ns"])
    rights = str(granted["scheduling policy"])
    json.dump({**timing.summary(), "rights": rights}, sys.stdout)


def _asker(stream: socket.socket) -> Exchange:
    def exchange() -> None:
        stream.sendall(b"?")
        if not stream.recv(1):
            raise ConnectionResetError("the process that answers has ended")

    return exchange


if __name__ == "__main__":
    main()
