"""The first and the last thing to read: figures at a glance, and what they were measured on."""

from __future__ import annotations

import json
from typing import Any

from hoap3.protocol.errors import LogError
from hoap3.tools.html.numbers import count, number, rate, seconds
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.stall_figures import figures, limited
from hoap3.tools.report.content import Content
from hoap3.tools.show.verdicts import deadline_words
from hoap3.tools.timing.ticks import IN_TIME

Tile = tuple[str, str, str, list[str]]


def tiles(content: Content) -> list[Tile]:
    """Anchor of the definition, name, value, and notes of each figure at the head."""
    found = _deadline_tiles(content, content.timing.figures) if content.timing else []
    motion, certificates = content.motion, content.certificates
    if motion is not None and motion.has_certificates:
        unit = " mm" if motion.target_m is not None else ""
        errors = (1e3 if unit else 1.0) * (2.0 * motion.v[motion.v >= 0.0]) ** 0.5
        notes = [f"√(2V); at first {number(errors[0])}{unit}"]
        share = rate(float(motion.certified.mean()))
        notes.append(f"certified {share} of n {count(len(motion.v))} answers")
        found.append(("word-certificate", "error at the end", f"{number(errors[-1])}{unit}", notes))
    if certificates is not None:
        notes = [f"of n {count(certificates.n)} answers"]
        if certificates.longest is not None:
            first = seconds(certificates.stretches[0].begin_s)
            longest = count(certificates.longest.answers)
            notes.append(f"first at {first} s, longest stretch {longest}")
        without = count(certificates.without)
        found.append(("certificates", "without certificate", without, notes))
    return found


def _deadline_tiles(content: Content, given: dict[str, Any]) -> list[Tile]:
    success, misses = given["success_rate"], given["misses"]
    worst = success["worst_window"]
    window = "fewer than 100 ticks" if worst is None else f"worst 100: {number(100.0 * worst)} %"
    ticks = [f"n {count(given['ticks'])} ticks", window]
    late = deadline_words(given)
    if late is not None:
        ticks.append(f"in time: {late}")
    found: list[Tile] = [("word-success", "success rate, raw", rate(success["run"]), ticks)]
    if not content.sources.lockstep:  # nobody can take virtual time away
        outside = rate(success["outside_stalls"])
        found.append(("word-stall", "outside stalls", outside, _stalls(content)))
    kinds = [f"late {count(misses['late'])}, lost {count(misses['lost'])}"]
    kinds.append(f"longest run {misses['longest_run']}; skipped {count(given['skipped'])}")
    missed = count(misses["late"] + misses["lost"])
    found.append(("word-outcome", "misses", missed, kinds))
    for key, anchor, name in (
        ("rtt_us", "word-rtt-word", "RTT"),
        ("wakeup_us", "word-wakeup-word", "wake-up"),
    ):
        sizes = given.get(key)
        if sizes and sizes["n"]:
            tail = f"p99 {number(sizes['p99'])}, p99.9 {number(sizes['p99_9'])}, "
            notes = [f"{tail}max {number(sizes['max'])} µs", f"n {count(sizes['n'])}"]
            found.append((anchor, f"{name}, median", f"{number(sizes['p50'])} µs", notes))
    return found


def _stalls(content: Content) -> list[str]:
    timing = content.timing
    if timing is None or timing.table.stalls is None:
        return ["nobody watched for stalls"]
    table, stalls = timing.table, figures(timing.stalls)
    misses = table.misses_outside_stalls or 0
    outside = f"n {count(table.count(IN_TIME) + misses)}, missed or skipped {count(misses)}"
    notes = [outside, f"{count(stalls['n'])} stalls, {number(stalls['total_ms'])} ms"]
    return [*notes, told] if (told := limited(stalls)) else notes


def machine_facts(content: Content, log: Log) -> tuple[str, list[tuple[str, str]], str]:
    """Side of a log, its machine block and versions, and its settings."""
    machine, versions = content.machine(log.side), log.metadata.get("versions", {})
    measures = content.sources.summary.get("realtime") if log.side == "robot" else None
    rows = [(k.replace("_", " "), _plain(v)) for k, v in machine.items() if k != "versions"]
    if measures:
        rows.append(("real-time measures", _plain(measures)))
    if versions:
        rows.append(("versions", ", ".join(f"{k} {v}" for k, v in versions.items())))
    rows.append(("log", ", ".join(str(path) for path in log.paths)))
    rows += [(k, v) for k, v in log.metadata.get("run", {}).items() if v]
    return log.side, rows, _settings(log)


def _settings(log: Log) -> str:
    try:
        return str(log.config).rstrip()
    except LogError as error:
        return str(error)


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    return value if isinstance(value, str) else json.dumps(value)
