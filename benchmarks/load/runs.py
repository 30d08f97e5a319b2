"""Runs of a robot in real time, by turns with something beside them and without it."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, NamedTuple

from scipy.stats import t

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.runtime.realtime import claim_cpu
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.bench.case_runner import median_ratio, run_in_turn
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.processes import Child
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.placement import placed
from hoap3.tools.services.run import run_realtime

CONFIDENCE = 0.95
QUIET = 1e-4
"""Share of ticks outside stalls that a quiet machine misses at most with nothing beside the robot.
Where it misses more, its own misses may decide what seems to be added."""
END_S = 10.0
READY = b"ready\n"
"""What a process says that now waits for the robot."""
CLIENTS = "benchmarks.load.clients"
PAGE = "benchmarks.load.page"
FLOOD = "benchmarks.load.flood"
ROBOT, LAW = "ur5", "steered_ur5"


def race(
    module: str,
    order: Mapping[str, Any],
    pairs: int,
    seconds: float,
    report: Callable[[int, int], None],
    *,
    realtime: bool = True,
    apart: bool = False,
) -> dict[str, Any]:
    """Pairs of runs, one with it and one without; which of them comes first changes by turns.

    Args:
        module: whose process runs beside the robot, such as `CLIENTS`.
        order: what it is told, besides `robot` and `endpoint`.
        pairs: how many, at least 2.
        seconds: of each run [s].
        report: takes how many runs are done, of how many.
        realtime: whether services pin and ask for priority.
        apart: whether it is kept off the loops' CPU, which is one for both then.

    Returns:
        `rows`, a figure of each run; `added`, what it adds to misses outside stalls and to the
        RTT; `did`, what the processes beside did; `cpus`, of the `loops` (none where they are not
        pinned) and of what was `beside` them.

    Raises:
        UsageError: it cannot be kept apart.
        Hoap3Error: a run failed, or what runs beside it did.
    """
    rows, did = [], []
    with ExitStack() as stack:
        robot = _placed(stack, realtime=realtime, apart=apart)
        cpus = {"loops": robot.cpus, "beside": os.sched_getaffinity(0)}
        if apart:
            cpus["beside"] = _others(cpus["beside"], cpus["loops"])
        turns = {
            way: partial(_run, robot, way and module, order, cpus["beside"], seconds)
            for way in ("", "beside")
        }
        for pair, way, (figures, done) in run_in_turn(turns, pairs, alternate=True):
            rows.append({"pair": pair, "beside": bool(way), **figures})
            did += [done] if done else []
            report(len(rows), 2 * pairs)
    listed = {which: sorted(those) for which, those in cpus.items()}
    return {"rows": rows, "added": added(rows), "did": did, "cpus": listed}


class _Robot(NamedTuple):
    """Both services as they run each time, and the CPUs that they are pinned to."""

    emulator: EmulatorConfig
    law: ControllerConfig
    files: tuple[str, str]
    cpus: set[int]


def _placed(stack: ExitStack, *, realtime: bool, apart: bool) -> _Robot:
    """Both, with CPUs that are theirs until the stack ends; on one, where others are to be left."""
    unlogged = ["log.record=false"]
    law, law_file = load_controller_config(LAW, unlogged, realtime=realtime)
    emulator, file = load_emulator_config(ROBOT, unlogged, realtime=realtime)
    if apart and realtime:
        claim = claim_cpu()
        if claim is None:
            raise UsageError("--apart: every CPU is claimed by another run. Wait until it ends")
        claims = [claim]
        ours, theirs = (
            side.realtime.model_copy(update={"cpu": claim.cpu}) for side in (emulator, law)
        )
    else:
        ours, theirs, claims = placed(emulator.realtime, law.realtime, lambda _: None)
    for each in claims:
        stack.callback(each.release)
    return _Robot(
        emulator.model_copy(update={"realtime": ours}),
        law.model_copy(update={"realtime": theirs}),
        (file, law_file),
        {side.cpu for side in (ours, theirs) if isinstance(side.cpu, int)},
    )


def _others(allowed: set[int], loops: set[int]) -> set[int]:
    """CPUs that the loops have not.

    Raises:
        UsageError: there are none, or the loops have none of their own.
    """
    if not loops:
        raise UsageError("--apart needs loops with a CPU of their own: leave out --no-realtime")
    if not allowed - loops:
        raise UsageError("--apart: no CPU is left beside that of the loops. Allow another one")
    return allowed - loops


def added(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the second of two ways to run adds, from pairs of runs.

    Returns:
        `pairs`; of the share of ticks missed or skipped outside stalls, and of all of them, the
        `mean` of the differences and its one-sided `upper` 95 % bound (Student's t), None where
        stalls were not watched; `alone`, the mean outside stalls of the runs without it, or None;
        `rtt_p99_ratio`, the median over the pairs, None where no run was answered.
    """
    found: dict[str, Any] = {}
    sides = [sorted((r for r in rows if r["beside"] is way), key=_pair) for way in (False, True)]
    for name in ("missed", "missed_outside"):
        pairs = [(a[name], b[name]) for a, b in zip(*sides, strict=True)]
        if any(None in pair for pair in pairs):
            found[name] = None
        else:
            found[name] = _bound([b - a for a, b in pairs])
    watched = found["missed_outside"] is not None
    found["alone"] = statistics.fmean(a["missed_outside"] for a in sides[0]) if watched else None
    alone, loaded = ([row["rtt_p99_us"] for row in side] for side in sides)
    found["rtt_p99_ratio"] = median_ratio(loaded, alone)
    return {"pairs": len(alone), **found}


def _pair(row: Mapping[str, Any]) -> int:
    return int(row["pair"])


def _bound(differences: Sequence[float]) -> dict[str, float]:
    n = len(differences)
    mean = sum(differences) / n
    deviation = math.sqrt(sum((each - mean) ** 2 for each in differences) / (n - 1))
    return {"mean": mean, "upper": mean + float(t.ppf(CONFIDENCE, n - 1)) * deviation / n**0.5}


def _run(
    robot: _Robot, module: str, order: Mapping[str, Any], cpus: set[int], seconds: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures of one run, and what the process beside it did, which is there before it begins."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    links = {"listen": (endpoint,)}, {"connect": (endpoint,), "kind": "zenoh"}
    done: dict[str, Any] = {}
    with ExitStack() as stack:
        if module:
            whole = {**order, "robot": ROBOT, "endpoint": endpoint}
            ours = os.sched_getaffinity(0)
            os.sched_setaffinity(0, cpus)  # which the child inherits
            try:
                child = Child([module], whole, stdout=subprocess.PIPE)
            finally:
                os.sched_setaffinity(0, ours)
            stack.callback(child.end, END_S)
            if child.stdout is None or child.stdout.readline() != READY:
                raise Hoap3Error(f"{module} ended at its start")
        summary = run_realtime(
            robot.emulator, robot.law, seconds, None, lambda _: None, robot.files, links=links
        )
        if module:
            child.cut()
            said, _ = child.communicate(timeout=END_S)
            done = json.loads(said or "{}")
            if child.returncode or not done or done["failed"]:
                why = (done.get("failed") or [f"it ended with code {child.returncode}"])[0]
                raise Hoap3Error(f"what ran beside the robot failed: {why}")
    asked = summary["ticks"] + summary["skipped"]
    missed = summary["misses"]["late"] + summary["misses"]["lost"] + summary["skipped"]
    outside = summary["misses_outside_stalls"]
    return {
        "ticks": asked,
        "missed": missed / asked,
        "missed_outside": None if outside is None else outside / asked,
        "rtt_p50_us": summary["rtt_us"].get("p50"),  # none where nothing was answered
        "rtt_p99_us": summary["rtt_us"].get("p99"),
        "safe_stops": summary["safe_stops"],
    }, done
