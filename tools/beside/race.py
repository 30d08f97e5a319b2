"""Runs of a robot in real time, by turns with something beside them and without it."""

from __future__ import annotations

import json
import math
import statistics
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from scipy.stats import t

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.processes import Child
from hoap3.tools.services.run import run_realtime
from hoap3.tools.services.services import controller_config, emulator_config

CONFIDENCE = 0.95
END_S = 10.0
READY = b"ready\n"
"""What a process says that now waits for the robot."""
CLIENTS = "hoap3.tools.beside.clients"
PAGE = "hoap3.tools.beside.page"
FLOOD = "hoap3.tools.beside.flood"
ROBOT, LAW = "ur5", "steered_ur5"


def race(
    module: str,
    order: Mapping[str, Any],
    pairs: int,
    seconds: float,
    report: Callable[[int, int], None],
    *,
    realtime: bool = True,
) -> dict[str, Any]:
    """Pairs of runs, one with it and one without; which of them comes first changes by turns.

    Args:
        module: whose process runs beside the robot, such as `CLIENTS`.
        order: what it is told, besides `robot` and `endpoint`.
        pairs: how many, at least 2.
        seconds: of each run [s].
        report: takes how many runs are done, of how many.
        realtime: whether services pin and ask for priority.

    Returns:
        `rows`, a figure of each run; `added`, what it adds to misses outside stalls and to the
        RTT; `did`, what the processes beside did.

    Raises:
        Hoap3Error: a run failed, or what runs beside it did.
    """
    rows, did = [], []
    for number in range(2 * pairs):
        pair, second = divmod(number, 2)
        there = bool(second) != bool(pair % 2)
        figures, done = _run(module if there else None, order, seconds, realtime=realtime)
        rows.append({"pair": pair, "beside": there, **figures})
        did += [done] if done else []
        report(number + 1, 2 * pairs)
    return {"rows": rows, "added": added(rows), "did": did}


def added(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the second of two ways to run adds, from pairs of runs.

    Returns:
        `pairs`; of the share of ticks missed or skipped outside stalls, and of all of them, the
        `mean` of the differences and its one-sided `upper` 95 % bound (Student's t), None where
        stalls were not watched; `rtt_p99_ratio`, the median over the pairs, None where no run was
        answered.
    """
    found: dict[str, Any] = {}
    sides = [sorted((r for r in rows if r["beside"] is way), key=_pair) for way in (False, True)]
    for name in ("missed", "missed_outside"):
        pairs = [(a[name], b[name]) for a, b in zip(*sides, strict=True)]
        if any(None in pair for pair in pairs):
            found[name] = None
        else:
            found[name] = _bound([b - a for a, b in pairs])
    times = [(a["rtt_p99_us"], b["rtt_p99_us"]) for a, b in zip(*sides, strict=True)]
    ratios = [b / a for a, b in times if a is not None and b is not None]
    found["rtt_p99_ratio"] = statistics.median(ratios) if ratios else None
    return {"pairs": len(times), **found}


def _pair(row: Mapping[str, Any]) -> int:
    return int(row["pair"])


def _bound(differences: Sequence[float]) -> dict[str, float]:
    n = len(differences)
    mean = sum(differences) / n
    deviation = math.sqrt(sum((each - mean) ** 2 for each in differences) / (n - 1))
    return {"mean": mean, "upper": mean + float(t.ppf(CONFIDENCE, n - 1)) * deviation / n**0.5}


def _run(
    module: str | None, order: Mapping[str, Any], seconds: float, *, realtime: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures of one run, and what the process beside it did, which is there before it begins."""
    unlogged = ["log.record=false"]
    law, law_file = controller_config(LAW, unlogged, realtime=realtime)
    emulator, file = emulator_config(ROBOT, unlogged, realtime=realtime)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    links = {"listen": (endpoint,)}, {"connect": (endpoint,), "kind": "zenoh"}
    done: dict[str, Any] = {}
    with ExitStack() as stack:
        if module:
            told = json.dumps({**order, "robot": ROBOT, "endpoint": endpoint})
            child = Child([module], told, stdout=subprocess.PIPE)
            stack.callback(child.end, END_S)
            if child.stdout is None or child.stdout.readline() != READY:
                raise Hoap3Error(f"{module} ended at its start")
        summary = run_realtime(
            emulator, law, seconds, None, lambda _: None, (file, law_file), links=links
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
