"""What people see of a measurement of the link."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from hoap3.tools.machine.stall_figures import limited
from hoap3.tools.show.output import results
from hoap3.tools.show.summary import coloured_verdict, durations_table, known, machine_line


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
    rate, misses = found["success_rate"], found["misses"]
    table.add_row(
        "deadlines", coloured_verdict(found["verdicts"]["deadlines"], found["deadlines"]["text"])
    )
    table.add_row(
        "success rate",
        f"{known(rate['run'], '.5f')} of {found['ticks']} ticks; worst window of 100: "
        f"{known(rate['worst_window'], '.2f')}",
    )
    table.add_row(
        "misses",
        f"late {misses['late']}, lost {misses['lost']}, longest run {misses['longest_run']}; "
        f"skipped ticks {found['skipped']}",
    )
    if found["host_stalls"] is None:
        table.add_row("host stalls", "not watched: every figure is raw")
    else:
        stalls, outside = found["host_stalls"], rate["outside_stalls"]
        table.add_row(
            "host stalls",
            f"{stalls['n']}, together {stalls['total_ms']:.1f} ms, longest "
            f"{stalls['longest_ms']:.1f} ms; outside them {found['misses_outside_stalls']} misses, "
            f"rate {known(outside, '.5f')}",
        )
        if told := limited(stalls):
            table.add_row("CPU time", told)
    guilty = ", ".join(f"{name} {count}" for name, count in found["guilty"].items())
    table.add_row("guilty", guilty or "nobody: no miss")
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
    for name in ("outcome", "guilty", "its three longest stages"):
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
