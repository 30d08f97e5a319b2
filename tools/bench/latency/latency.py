"""`hoap3 latency`: what the link costs, whether deadlines hold, and whose fault each miss was.

A robot and a controller that computes nothing run through the same services, loops and links as
always; a bare TCP echo, placed and paced like them, runs beside them in the other half of each
period, so that whatever the machine does falls on both. The same figures can be had from any log.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, LogError, UsageError
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.service import describe
from hoap3.tools.analysis.deadline_verdict import FAIL, MISSES_TO_STOP, NOT_JUDGED
from hoap3.tools.analysis.output import results
from hoap3.tools.analysis.summary import (
    add_deadlines,
    coloured_verdict,
    durations_table,
    known,
    machine_line,
)
from hoap3.tools.analysis.tick_metrics import percentiles, tick_figures
from hoap3.tools.analysis.ticks import TickTable
from hoap3.tools.bench.case_runner import median_ratio, run_in_turn
from hoap3.tools.bench.latency.echo import BareEcho, Exchanges
from hoap3.tools.bench.latency.nodes import NullController
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.loopback_links import ZENOH, LinkPair, free_port, link
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.machine.stalls import limited
from hoap3.tools.services.certificates import init, issue
from hoap3.tools.services.messages import LoopEvent, Message
from hoap3.tools.services.placement import placed
from hoap3.tools.services.run import run_realtime

WARM_UP = 200
"""Ticks at the begin of each block that enter no figure: caches, branch predictors, sockets."""

TLS = "tls"
VALID = timedelta(days=1)
CERTIFIED = "latency_controller"
NULL_CONTROLLER = f"{NullController.__module__}:{NullController.__qualname__}"
_NEVER_STOP = 1_000_000_000  # misses in a row: a measurement goes on, and says how many there were

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Plan:
    """What is measured.

    Attributes:
        emulator: the robot; its link is replaced.
        link: one of `hoap3.tools.machine.loopback_links.LINKS`, or "tls": with certificates, in
            turns with "tcp".
        blocks, ticks: how many blocks, and ticks of each.
        realtime: whether to pin, and to ask for priority.
        out: folder for the logs, one inside for each block; None to keep none.
    """

    emulator: EmulatorConfig
    link: str = "tcp"
    blocks: int = 5
    ticks: int = 2000
    realtime: bool = True
    out: Path | None = None


def measure_latency(
    plan: Plan,
    progress: Progress = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Measure a link and the echo beside it; docs/guides/measuring.md defines each figure.

    Args:
        plan: what is measured.
        progress: told what happens, for people.
        should_stop: asked between and within blocks; what is complete by then is the result.

    Raises:
        UsageError: the link is unknown, or lacks something.
        Hoap3Error: a process could not do its work, or the end came before the first block's.
    """
    description = describe(plan.emulator)
    tables: list[TickTable] = []
    plain: list[TickTable] = []  # of Zenoh over TCP, in turns with TLS
    echoes: list[Exchanges] = []
    said: list[str] = []
    with (
        _placement(plan, progress) as sides,
        tempfile.TemporaryDirectory(prefix="hoap3-latency-") as scratch,
    ):
        folder = plan.out or Path(scratch)

        def block(name: str, kind: str) -> tuple[TickTable, Exchanges, list[str]]:
            progress(f"block {len(tables) + 1} of {plan.blocks}: {transport(kind)}")
            with _link(kind, description.name) as pair:
                one = folder / f"{name}{len(tables)}"
                return _block(plan, sides, pair, one, should_stop)

        turns = {"plain": partial(block, "plain", "tcp")} if plan.link == TLS else {}
        turns["block"] = partial(block, "block", plan.link)
        try:
            for _, name, (table, echo, granted) in run_in_turn(turns, plan.blocks):
                if should_stop():
                    break
                if name == "plain":
                    plain.append(table)
                    continue
                tables.append(table)
                echoes.append(echo)
                said = granted
        except Hoap3Error:
            if not should_stop():
                raise
    if not tables:
        raise Hoap3Error("interrupted before the first block was complete")
    return {
        **tick_figures(tables, MISSES_TO_STOP, said),
        **compare(tables, echoes),
        "plain_rtt_us": _rtt(plain) if plain else None,
        "link": plan.link,
        "bytes": dict(zip(("state", "setpoint"), sizes(plan, description), strict=True)),
        "period_us": description.period_s * 1e6,
        "ticks_per_block": plan.ticks,
        "warm_up_ticks": WARM_UP,
        "final_error": None,
        "realtime": said,
        "machine": machine_block(),
        "transport": f"{transport(plan.link)}, same host",
        "log": str(plan.out) if plan.out else None,
    }


def analyse_log(path: Path) -> dict[str, Any]:
    """The same figures of a run that was recorded, as far as they can be had without an echo.

    Args:
        path: folder of the run, or the log of its robot alone.

    Raises:
        LogError: the robot's log is missing or cannot be read.
    """
    table = TickTable.from_run(path)
    log = Log.open(path, side="robot") if path.is_dir() else Log.open(path)
    if not table.asked.any():
        cut = f" The log is not complete: {log.missing}" if log.missing else ""
        raise LogError(
            f"{path}: no tick asked for an answer.{cut} Name the log of a robot that moved"
        )
    machine = {name: json.loads(value) for name, value in log.metadata.get("machine", {}).items()}
    figures = tick_figures([table])
    if (log.truncated or log.damages) and figures["verdicts"]["deadlines"] != FAIL:
        figures["verdicts"]["deadlines"] = NOT_JUDGED  # the rest is not known
        figures["deadlines"]["text"] = "the log is damaged; " + figures["deadlines"]["text"]
    return {
        **figures,
        "echo_rtt_us": None,
        "rtt_ratio": None,
        "period_us": table.period / 1e3,
        "warm_up_ticks": 0,
        "virtual_time": table.lockstep,
        "missing": log.missing,
        "left_out": table.left_out,
        "final_error": None,
        "machine": machine,
        "transport": "as the log was recorded",
        "log": str(path),
    }


def compare(tables: Sequence[TickTable], echoes: Sequence[Exchanges]) -> dict[str, Any]:
    """How the RTT of each block compares with that of the echo beside it.

    Returns:
        `rtt_ratio`, the median over the blocks of p50 ÷ p50; `echo_rtt_us` of all blocks;
        `blocks` with both medians [us], the ratio, and the skipped ticks of the echo.
    """
    blocks = []
    for table, echo in zip(tables, echoes, strict=True):
        ours = percentiles(table.stage("rtt")).get("p50")
        theirs = percentiles(echo.rtt).get("p50")
        blocks.append(
            {
                "rtt_p50_us": ours,
                "echo_rtt_p50_us": theirs,
                "ratio": median_ratio([ours], [theirs]),
                "echo_skipped": echo.skipped,
            }
        )
    columns = ([block[name] for block in blocks] for name in ("rtt_p50_us", "echo_rtt_p50_us"))
    return {
        "rtt_ratio": median_ratio(*columns),
        "echo_rtt_us": percentiles(np.concatenate([echo.rtt for echo in echoes])),
        "blocks": blocks,
    }


def transport(link: str) -> str:
    """What carries the messages over a link of that name."""
    return f"zenoh over {link}" if link in {*ZENOH, TLS} else link


def sizes(plan: Plan, description: RobotDescription) -> tuple[int, int]:
    """Bytes that carry a State and a Setpoint of this robot."""
    if plan.link not in {*ZENOH, TLS}:
        frame = Frames(description, plan.emulator.link.hoap3_tcp.slots).size
        return frame, frame
    n = description.n
    return State.allocate(**description.state_lengths).size, Setpoint(n).size


def _link(name: str, robot: str) -> AbstractContextManager[LinkPair]:
    """What both sides meet over, for as long as it is held."""
    return secured(robot) if name == TLS else link(name)


def _rtt(tables: Sequence[TickTable]) -> dict[str, Any]:
    """Percentiles of the round trips of some blocks [us]."""
    return percentiles(np.concatenate([table.stage("rtt") for table in tables]))


def _block(
    plan: Plan,
    sides: tuple[RealtimeSettings, RealtimeSettings],
    links: LinkPair,
    folder: Path,
    should_stop: Callable[[], bool],
) -> tuple[TickTable, Exchanges, list[str]]:
    """Run one block; its ticks without the warm-up, the echo's, and what both were granted."""
    description = describe(plan.emulator)
    robot, controller = sides
    emulator = plan.emulator.model_copy(update={"realtime": robot, "misses_to_stop": _NEVER_STOP})
    law = ControllerConfig(controller=NULL_CONTROLLER, realtime=controller)
    ticks, period_s = plan.ticks + WARM_UP, description.period_s
    period_ns = round(period_s * 1e9)
    order = {"ticks": ticks, "period_ns": period_ns, "sizes": sizes(plan, description)}
    with closing(BareEcho(order, robot, controller)) as echo:

        def begin_when_granted(message: Message) -> None:
            if isinstance(message, LoopEvent) and message.name == "granted":
                echo.begin()

        summary = run_realtime(
            emulator,
            law,
            ticks * period_s,
            folder,
            begin_when_granted,
            links=links,
            should_stop=should_stop,
        )
        if summary["log_lost"]:
            raise Hoap3Error("; ".join(summary["log_lost"]))
        table = TickTable.from_run(folder).after(WARM_UP)
        if not len(table):
            raise Hoap3Error("the robot did not move for longer than the warm-up")
        exchanges = echo.result().between(table.intended[0], table.intended[-1] + period_ns)
    return table, exchanges, summary["realtime"]


@contextmanager
def _placement(
    plan: Plan, progress: Progress
) -> Iterator[tuple[RealtimeSettings, RealtimeSettings]]:
    """Places for both sides, as `hoap3 run` would give them, for as long as this is held."""
    if not plan.realtime:
        plain = RealtimeSettings(policy="none", cpu="none", lock_memory=False)
        yield plain, plain
        return
    robot, controller, claims = placed(plan.emulator.realtime, RealtimeSettings(), progress)
    try:
        if controller.cpu == "auto":
            allowed = sorted(os.sched_getaffinity(0))
            raise UsageError(
                f"every allowed CPU ({', '.join(map(str, allowed))}) is claimed by another run: "
                "the figures would be those of both. Wait for its end, or use --no-realtime"
            )
        yield robot, controller
    finally:
        for claim in claims:
            claim.release()


@contextmanager
def secured(robot: str) -> Iterator[LinkPair]:
    """Settings for both sides; their certificates exist until this ends.

    Raises:
        NotInstalledError: cryptography is not installed.
    """
    endpoint = f"{TLS}/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory(prefix="hoap3-certs-") as folder:
        certs = Path(folder)
        init(certs, VALID)
        issue(certs, robot, "robot", [], VALID)
        issue(certs, CERTIFIED, "controller", [], VALID)
        yield (
            {"listen": (endpoint,), "secure": str(certs / robot)},
            {"connect": (endpoint,), "secure": str(certs / CERTIFIED)},
        )


def show_latency(found: dict[str, Any]) -> None:
    """Print the figures of `measure_latency` or `analyse_log`."""
    results.print(_verdict(found))
    if "rtt_us" in found:
        results.print(_durations(found))
        results.print(_worst(found["worst"]))
    results.print(machine_line(found), markup=False)
    for measure in found.get("realtime", []):
        results.print(f"  {measure}", markup=False)
    if found["log"]:
        results.print(f"log: {found['log']}", markup=False, soft_wrap=True)


def _verdict(found: dict[str, Any]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row(
        "deadlines", coloured_verdict(found["verdicts"]["deadlines"], found["deadlines"]["text"])
    )
    add_deadlines(table, found)
    if found["host_stalls"] is None:
        table.add_row("host stalls", "not watched: every figure is raw")
    else:
        stalls, outside = found["host_stalls"], found["success_rate"]["outside_stalls"]
        table.add_row(
            "host stalls",
            f"{stalls['n']}, together {stalls['total_ms']:.1f} ms, longest "
            f"{stalls['longest_ms']:.1f} ms; outside them {found['misses_outside_stalls']} misses, "
            f"rate {known(outside, '.5f')}",
        )
        if told := limited(stalls):
            table.add_row("CPU time", told)
    stages = ", ".join(f"{name} {count}" for name, count in found["guilty"].items())
    table.add_row("misses by stage", stages or "none: no miss")
    if found["rtt_ratio"] is not None:
        ratios = ", ".join(f"{block['ratio']:.1f}" for block in found["blocks"] if block["ratio"])
        table.add_row("RTT ÷ echo", f"{found['rtt_ratio']:.2f}, median of {ratios}")
    if found["warm_up_ticks"]:
        table.add_row("warm-up", f"first {found['warm_up_ticks']} ticks of each block left out")
    if found.get("virtual_time"):
        table.add_row("time", "virtual: durations say nothing of a machine")
    if found.get("missing"):
        table.add_row("missing", found["missing"])
    return table


def _durations(found: dict[str, Any]) -> Table:
    rows = {"RTT": found["rtt_us"], "bare echo": found["echo_rtt_us"] or {"n": 0}}
    if found.get("plain_rtt_us"):
        rows["RTT in plain"] = found["plain_rtt_us"]
    rows |= {"response": found["response_us"]}
    rows |= {f"  {name}": stage for name, stage in found["stages_us"].items()}
    return durations_table(rows, found["jitter_us"])


def _worst(ticks: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, title="longest round trips, us", title_justify="left")
    for name in ("block", "tick", "RTT"):
        table.add_column(name, justify="right")
    for name in ("outcome", "attributed to", "its three longest stages"):
        table.add_column(name)
    for tick in ticks:
        stages = sorted(tick["stages_us"].items(), key=lambda pair: -pair[1])[:3]
        table.add_row(
            str(tick["block"]),
            str(tick["tick"]),
            f"{tick['rtt_us']:.0f}",
            tick["outcome"],
            tick["guilty"] or "",
            ", ".join(f"{name} {length:.0f}" for name, length in stages),
        )
    return table
