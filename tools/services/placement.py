"""Which CPUs both sides get: one for both, or one each, whichever was better on this machine.

The first run after a boot measures both placements and stores the finding; later ones read it. One
process sends requests as a robot does, at each tick of 1 kHz; two others answer as a controller
does, one on the same CPU and one on another. Both placements take turns, a few ticks each, so that
whatever the machine does meanwhile falls on both alike. Messages have the size of HOAP-3's; nothing
is computed.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hoap3.protocol.config.settings import LinkSettings, RealtimeSettings
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.link.base import RobotLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import Clock, MonotonicClock
from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.notes import Detail
from hoap3.protocol.runtime.private_directory import runtime_directory
from hoap3.protocol.runtime.realtime import CpuClaim, Ticker, claim_cpu, claim_cpus, prepare_process
from hoap3.tools.logs.files import whole_file
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.processes import Child, die_with_parent, read_order
from hoap3.tools.machine.stalls import StallMonitor

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_LARGEST = 64_000  # bytes of a stored finding

Report = Callable[[str], None]
Policy = Literal["auto", "none"]


def chosen(report: Report) -> str:
    """Return "one_cpu" or "two_cpus": the stored finding of this boot, or a new measurement.

    Where it cannot be measured, one CPU: it needs no second one to be free, nor to be woken.

    Args:
        report: takes what was found, in words.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return "one_cpu"
    found = _stored()
    if found is None:
        report("placement: measuring one CPU and two, once per boot: some three seconds")
        found = measure_placement()
        remember(found)
    choice: str = found.get("recommended", "one_cpu")
    words = {"one_cpu": "one CPU for both sides", "two_cpus": "one CPU for each side"}
    report(Detail(f"placement: {words[choice]} ({found['why']})"))
    return choice


def remember(found: dict[str, Any]) -> None:
    """Store a finding until the next boot, unless it says nothing of one of the placements."""
    directory = runtime_directory()
    if directory is None or "two_cpus" not in found:
        return
    kept = {"boot": _boot(), "allowed": sorted(os.sched_getaffinity(0)), "found": found}
    with (
        contextlib.suppress(OSError),  # it is measured again next time
        whole_file(directory / "placement.json") as draft,
    ):
        draft.write_text(json.dumps(kept), encoding="utf-8")


def _stored() -> dict[str, Any] | None:
    """What was found on these CPUs since the machine was started, or None."""
    directory = runtime_directory()
    if directory is None:
        return None
    try:
        with (directory / "placement.json").open("rb") as stream:
            kept = json.loads(stream.read(_LARGEST))
        now = {"boot": _boot(), "allowed": sorted(os.sched_getaffinity(0))}
        if not now.items() <= kept.items():
            return None
        found: dict[str, Any] = kept["found"]
        known = found["recommended"] in {"one_cpu", "two_cpus"} and isinstance(found["why"], str)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None  # none yet, or not ours: it is measured again
    return found if known else None


def _boot() -> str:
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def placed(
    robot: RealtimeSettings, controller: RealtimeSettings, report: Report
) -> tuple[RealtimeSettings, RealtimeSettings, list[CpuClaim]]:
    """Both sides with the CPUs that `auto` gets, and the claims that hold these.

    The controller has the last CPU, as where it is alone: a robot beside it did better on the one
    before, where fewer interrupts were handled. A side that names its CPU has it, and the other
    shares it or takes another, as measured. Where none is left, `auto` stays: the service itself
    says so.

    Args:
        robot, controller: settings of both sides.
        report: takes what was found about placements, in words.
    """
    sides = (controller, robot)
    autos = sum(side.cpu == "auto" for side in sides)
    named = [side.cpu for side in sides if isinstance(side.cpu, int)]
    if not autos:
        return robot, controller, []
    together = autos + len(named) == 2 and chosen(report) == "one_cpu"
    claims: list[CpuClaim] = []
    if not (together and named):
        allowed = os.sched_getaffinity(0) - set(named)
        wanted = 1 if together else autos
        claims = claim_cpus(wanted, allowed)
    cpus = [claim.cpu for claim in claims] or (named if together else [])
    return _pinned(robot, cpus[-1:]), _pinned(controller, cpus[:1]), claims


def settled_alone(
    settings: RealtimeSettings, side: str, report: Report
) -> tuple[RealtimeSettings, CpuClaim | None]:
    """A service's settings with the CPU that `auto` gets, and the claim that holds it.

    On one CPU for both, robot and controller claim a side each of the highest one where theirs is
    free. Otherwise a robot leaves the last CPU to its controller.

    Args:
        settings: of the service.
        side: "robot" or "controller".
        report: takes what was found about placements, in words.
    """
    if settings.cpu != "auto":
        return settings, None
    if chosen(report) == "one_cpu":
        claim = claim_cpu(sides=(side,))
    else:
        claim = claim_cpu(leave=1 if side == "robot" else 0)
    return _pinned(settings, [claim.cpu] if claim else []), claim


def _pinned(side: RealtimeSettings, cpu: list[int]) -> RealtimeSettings:
    return side.model_copy(update={"cpu": cpu[0]}) if side.cpu == "auto" and cpu else side


PERIOD_NS = 1_000_000
TICKS = 800  # of each placement: less than a second
TURN = 20  # ticks until it is the other placement's turn
NEAR = 1.1
"""Two p99 that differ by less than this factor are equal: 800 ticks do not tell them apart."""

LOST = 0.01  # share of answers that may not come; the p99 says nothing of more
PATIENCE_NS = 500_000_000  # for the last answers: a late one is not lost
JOINTS = 21
_TICK = struct.Struct("<q")  # the first bytes of a question, and of its answer
_TIMEOUT_S = 10.0  # for processes to start, or beyond the time that everything should take


@dataclass(frozen=True)
class Order:
    """What is to be measured.

    Attributes:
        cpu: of the process that asks.
        echoes: CPU of the process that answers, by placement.
        ticks: of each placement.
        period_ns: from one to the next.
        policy: "auto" or "none", as `realtime.policy`.
    """

    cpu: int
    echoes: Mapping[str, int]
    ticks: int = TICKS
    period_ns: int = PERIOD_NS
    policy: Policy = "auto"


Runner = Callable[[Order], dict[str, Any]]
"""Carries an order out: figures as `exchange` returns them, and `rights`, what was granted."""


def exchange(
    peers: Mapping[str, RobotLink], clock: Clock, ticks: int, period_ns: int, size: int
) -> dict[str, Any]:
    """Ask each peer in turn, once a period, and time the answers.

    The first tick of each turn finds the other placement's caches, so that it does not count, nor
    does the first turn of each.

    Args:
        peers: one for each placement.
        clock: that paces and stamps.
        ticks: of each placement.
        period_ns: from one to the next.
        size: bytes of a question.

    Returns:
        `rtt_us` by placement and `wakeup_us`, as `Durations.summary`, `lost` answers by placement,
        and the number of `skipped` ticks.
    """
    rounds = 1 + -(-ticks // (TURN - 1))
    plan = [name for _ in range(rounds) for name in peers for _ in range(TURN)]
    sent = [0] * len(plan)
    counted = [at >= TURN * len(peers) and at % TURN > 0 for at in range(len(plan))]
    rtt = {name: Durations() for name in peers}
    wakeup, skipped = Durations(), 0
    question = bytearray(size)
    ticker = Ticker(clock, period_ns, clock.now() + period_ns)

    def receive() -> None:
        for name, peer in peers.items():
            for stamp, answer in peer.drain():
                (at,) = _TICK.unpack_from(answer)
                if counted[at] and rtt[name].n < ticks:
                    rtt[name].add(stamp - sent[at], at)

    asked = dict.fromkeys(peers, 0)
    for at, name in enumerate(plan):
        ticker.wait()
        _TICK.pack_into(question, 0, at)
        sent[at] = clock.now()
        peers[name].publish(bytes(question))
        skipped += ticker.skipped
        if counted[at]:
            asked[name] += 1
            wakeup.add(ticker.actual - ticker.intended, ticker.tick)
        receive()

    def missing() -> dict[str, int]:
        return {name: max(0, min(asked[name], ticks) - rtt[name].n) for name in peers}

    end = clock.now() + PATIENCE_NS
    while any(missing().values()) and clock.now() < end:
        clock.sleep_until(clock.now() + TURN * period_ns)
        receive()
    return {
        "rtt_us": {name: durations.summary() for name, durations in rtt.items()},
        "lost": missing(),
        "wakeup_us": wakeup.summary(),
        "skipped": skipped,
    }


def measure_placement(
    runner: Runner | None = None,
    *,
    claim: Callable[[int], list[CpuClaim]] = claim_cpus,
    ticks: int = TICKS,
    policy: Policy = "auto",
) -> dict[str, Any]:
    """Measure both placements on CPUs that no run has claimed, and choose between them.

    Stall monitors keep the CPUs awake meanwhile where that is allowed, as in a run.

    Args:
        runner: carries the order out; by default processes do.
        claim: gives up to so many CPUs that are ours for as long as this takes.
        ticks: of each placement.
        policy: "auto" asks for real-time priority, "none" does not.

    Returns:
        `measured`; where it is true, figures of `one_cpu` and, with two CPUs, of `two_cpus`,
        `rights`, `wakeup_us`, `skipped`, and what `recommend` says; else only `why`.
    """
    claims = claim(2)
    if not claims:
        return {"measured": False, "why": "every allowed CPU is claimed by a run"}
    cpus = [claimed.cpu for claimed in claims]
    echoes = dict(zip(("one_cpu", "two_cpus"), cpus, strict=False))
    try:
        with StallMonitor(cpus, keep_awake=True):
            figures = (runner or run_processes)(Order(cpus[0], echoes, ticks, policy=policy))
    except (Hoap3Error, OSError, ValueError, subprocess.SubprocessError) as error:
        return {"measured": False, "why": f"the processes gave no figures: {error}"}
    finally:
        for claimed in claims:
            claimed.release()
    rtt, lost = figures.pop("rtt_us"), figures.pop("lost")
    worst = max(lost.values())
    if worst > ticks * LOST:
        return {"measured": False, "why": f"{worst} of {ticks} answers did not come"}
    return {
        "measured": True,
        **figures,
        **{
            name: {"cpus": sorted({cpus[0], echo}), "rtt_us": rtt[name], "lost": lost[name]}
            for name, echo in echoes.items()
        },
        **recommend(rtt, cpus),
    }


def recommend(rtt: Mapping[str, Mapping[str, Any]], cpus: Sequence[int]) -> dict[str, Any]:
    """Choose the placement with the smaller p99 of the RTT, or p50 where the p99 are near.

    Args:
        rtt: figures [us] by placement.
        cpus: the controller's, and the robot's if they have one each.

    Returns:
        `recommended`, a placement, and `why`; `realtime_cpu`, the setting `realtime.cpu` of both
        sides that brings it about.
    """
    choice, why = "one_cpu", "no second CPU is free"
    if "two_cpus" in rtt:
        one, two = rtt["one_cpu"], rtt["two_cpus"]
        apart = max(one["p99"], two["p99"]) > NEAR * min(one["p99"], two["p99"])
        key = "p99" if apart else "p50"
        choice = "two_cpus" if two[key] < one[key] else "one_cpu"
        why = f"RTT {key} {one[key]:.0f} us on one CPU, {two[key]:.0f} us on two"
    robot = cpus[0] if choice == "one_cpu" else cpus[1]
    return {
        "recommended": choice,
        "why": why,
        "realtime_cpu": {"emulator": robot, "controller": cpus[0]},
    }


def run_processes(order: Order) -> dict[str, Any]:
    """Carry an order out with a process that asks and one that answers for each placement.

    Raises:
        OSError, ValueError, subprocess.SubprocessError: a process did not do its part.
    """
    ports = {name: free_port() for name in order.echoes}
    settings = RealtimeSettings(policy=order.policy, lock_memory=False)
    children: list[Child] = []
    try:
        for name, cpu in order.echoes.items():
            realtime = settings.model_copy(update={"cpu": cpu})
            children.append(_start({"answers": name, "ports": ports, "realtime": realtime}))
        asks = {"ports": ports, "ticks": order.ticks, "period_ns": order.period_ns}
        realtime = settings.model_copy(update={"cpu": order.cpu})
        children.append(_start({**asks, "realtime": realtime}))
        planned = (order.ticks + 2 * TURN) * len(order.echoes) * order.period_ns * 1e-9
        out, errors = children[-1].communicate(timeout=2 * planned + 2 * _TIMEOUT_S)
        if children[-1].returncode:
            raise ValueError(errors.decode(errors="replace").strip().rpartition("\n")[2])
        figures: dict[str, Any] = json.loads(out)
        return figures
    finally:
        for child in children:
            child.kill()
            child.communicate()


def _start(order: dict[str, Any]) -> Child:
    module = ["hoap3.tools.services.placement"]
    return Child(module, order, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def main() -> None:
    """Be one of the processes; the order comes on standard input, figures go to standard output."""
    die_with_parent()
    order = read_order()
    granted = {measure.name: measure for measure in prepare_process(order["realtime"])}
    if not granted["CPU"].obtained:
        sys.exit(str(granted["CPU"]))
    if "answers" in order:
        _answer(order["answers"], order["ports"][order["answers"]])
        return
    figures = _ask(order["ports"], order["ticks"], order["period_ns"])
    json.dump({**figures, "rights": str(granted["scheduling policy"])}, sys.stdout)


def _answer(name: str, port: int) -> None:
    """Answer each question with its tick, until killed."""
    from hoap3.protocol.link.zenoh_link import ZenohControllerLink

    settings = LinkSettings(connect=(f"tcp/127.0.0.1:{port}",))
    link = ZenohControllerLink(name, settings, "placement")
    answer = bytearray(Setpoint(JOINTS).size)
    while True:
        arrival = link.wait()
        if arrival is not None:
            answer[: _TICK.size] = arrival[1][: _TICK.size]
            link.publish(bytes(answer))


def _ask(ports: Mapping[str, int], ticks: int, period_ns: int) -> dict[str, Any]:
    """Ask both, once each has answered."""
    from hoap3.protocol.link.zenoh_link import ZenohRobotLink

    clock, size = MonotonicClock(), State(JOINTS).size
    links: dict[str, ZenohRobotLink] = {}
    try:
        for name, port in ports.items():
            settings = LinkSettings(listen=(f"tcp/127.0.0.1:{port}",))
            links[name] = ZenohRobotLink(name, settings)
        limit = clock.now() + round(_TIMEOUT_S * 1e9)
        for name, link in links.items():
            while not link.drain():  # a question that nobody heard is asked again
                if clock.now() > limit:
                    sys.exit(f"the process that answers on {name} did not begin")
                link.publish(bytes(size))
                clock.sleep_until(clock.now() + 20 * period_ns)
        clock.sleep_until(clock.now() + 50 * period_ns)  # what is still under way
        for link in links.values():
            link.drain()
        return exchange(links, clock, ticks, period_ns, size)
    finally:
        for link in links.values():
            link.close()


if __name__ == "__main__":
    main()
