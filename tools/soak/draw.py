"""The picture of a soak: the memory of each process over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoap3.tools.soak.watch import Watch

LEAST_RANGE_MB = 2.0  # of an axis, or every page that comes and goes would fill it


def draw(watch: Watch, result: dict[str, Any], path: Path) -> None:
    """Draw a panel a process, all of the soak, the warm-up shaded, as a PNG.

    Raises:
        OSError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    seen = {pid: rounds.since(0.0) for pid, rounds in watch.processes.items()}
    memory = {each["pid"]: each["memory"] for each in result["processes"]}
    rows = max(len(seen), 1)  # none where it ended before the first round
    figure = Figure(figsize=(8, 1.2 + 1.3 * rows), layout="constrained")
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (pid, held) in zip(panels, seen.items(), strict=False):
        rss = held["rss_bytes"] / 1e6
        axes.plot(held["t"] / 60, rss, linewidth=1.0)
        half = max(LEAST_RANGE_MB, 1.1 * (rss.max() - rss.min())) / 2
        middle = (rss.max() + rss.min()) / 2
        axes.set_ylim(middle - half, middle + half)
        axes.axvspan(0.0, result["plan"]["warm_up_s"] / 60, color="0.9")
        title = watch.processes[pid].label + _growth(memory.get(pid))
        axes.set_title(title, size=9, loc="left")
        axes.grid(alpha=0.25)
    panels[-1].set_xlabel("time since the robot began to move [min]; grey: warm-up")
    figure.supylabel("resident memory [MB]", size=9)
    machine = result["machine"]
    figure.suptitle(f"{machine['processor']}, kernel {machine['kernel']}", size=9)
    figure.savefig(path, dpi=120, format="png")


def _growth(memory: dict[str, Any] | None) -> str:
    """How fast it grows, where that is known."""
    if memory is None or memory["upper_mb_per_hour"] is None:
        return ""
    slope, upper = memory["slope_mb_per_hour"], memory["upper_mb_per_hour"]
    return f": {slope:+.2f} MB/h, at most {upper:+.2f}"
