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

    shown = [rounds for rounds in watch.processes.values() if len(rounds.since(0.0)["t"]) > 1]
    figure = Figure(figsize=(8, 1.2 + 1.3 * max(len(shown), 1)), layout="constrained")
    panels = figure.subplots(max(len(shown), 1), 1, sharex=True, squeeze=False)[:, 0]
    slopes = {each["pid"]: each["memory"] for each in result["processes"]}
    named = {id(rounds): pid for pid, rounds in watch.processes.items()}
    for axes, rounds in zip(panels, shown, strict=False):
        seen = rounds.since(0.0)
        rss = seen["rss_bytes"] / 1e6
        axes.plot(seen["t"] / 60, rss, linewidth=1.0)
        middle, half = (
            (rss.max() + rss.min()) / 2,
            max(LEAST_RANGE_MB, 1.1 * (rss.max() - rss.min())) / 2,
        )
        axes.set_ylim(middle - half, middle + half)
        axes.axvspan(0.0, result["plan"]["warm_up_s"] / 60, color="0.9")
        memory = slopes.get(named[id(rounds)], {})
        upper = memory.get("upper_mb_per_hour")
        words = (
            ""
            if upper is None
            else f": {memory['slope_mb_per_hour']:+.2f} MB/h, at most {upper:.2f}"
        )
        axes.set_title(rounds.label + words, size=9, loc="left")
        axes.grid(alpha=0.25)
    panels[-1].set_xlabel("time since the robot began to move [min]; grey: warm-up")
    figure.supylabel("resident memory [MB]", size=9)
    machine = result["machine"]
    figure.suptitle(f"{machine['processor']}, kernel {machine['kernel']}", size=9)
    figure.savefig(path, dpi=120, format="png")
