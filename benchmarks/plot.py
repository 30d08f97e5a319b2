"""The pictures of `benchmarks.scaling` and `benchmarks.hierarchy`: time over size, logarithmic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoap3.protocol.errors import ConfigError
from hoap3.tools.machine.machine import check_extra

FIT_FROM = 100
"""Joints from which slopes are fitted: below, the call itself costs more than the joints do."""

FORMATS = (".png", ".svg", ".pdf")


def check_picture(path: Path) -> None:
    """Refuse a picture that could not be written, before anything is measured for it.

    Raises:
        ConfigError: the name does not end in a format, or its folder does not exist.
        NotInstalledError: nothing can be drawn here.
    """
    check_extra("report")
    if path.suffix.lower() not in FORMATS:
        allowed = f"End its name in {', '.join(FORMATS)}"
        raise ConfigError("--plot", "", str(path), "is no name of a picture", allowed)
    if not path.parent.is_dir():
        raise ConfigError("--plot", "", str(path), "its folder does not exist", "Make it first")


def draw_scaling(measured: dict[str, Any], path: Path) -> None:
    """Draw what `bench_scaling` gives, one line a solver, its slope in the legend.

    Raises:
        ConfigError: the picture cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    machine = measured["machine"]
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    axes = figure.add_subplot()
    rows, slopes = measured["rows"], measured["slopes"]
    for name in dict.fromkeys(row["solver"] for row in rows):
        points = [(row["n"], row["p50_us"]) for row in rows if row["solver"] == name]
        label = f"{name}, slope {slopes[name]:.2f}" if name in slopes else name
        axes.loglog(*zip(*points, strict=True), marker="o", markersize=4, label=label)
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axes.set_xticks(sorted({row["n"] for row in rows}), minor=False)
    axes.xaxis.set_major_formatter(plain)
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda _, __: ""))
    axes.yaxis.set_major_formatter(plain)
    axes.set_xlabel("joints n")
    axes.set_ylabel("median time of a call from Python [µs]")
    axes.set_title(f"QP12 by solver\n{machine['processor']}, kernel {machine['kernel']}", size=10)
    axes.grid(which="both", alpha=0.25)
    title = f"slopes from {FIT_FROM} joints on"
    axes.legend(loc="upper left", fontsize=9, title=title, title_fontsize=9)
    _write(figure, path)


def draw_hierarchies(measured: dict[str, Any], path: Path) -> None:
    """Draw what `bench_hierarchy` gives: a panel a robot, a line a solver and case, over tasks.

    Raises:
        ConfigError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    machine = measured["machine"]
    rows = [row for row in measured["rows"] if row["times_ghc"] is not None]
    robots = list(dict.fromkeys((row["robot"], row["n"]) for row in rows))
    figure = Figure(figsize=(5 * len(robots), 5), layout="constrained")
    panels = figure.subplots(1, len(robots), sharey=True, squeeze=False)[0]
    colours: dict[str, str] = {}
    for axes, (robot, n) in zip(panels, robots, strict=True):
        own = [row for row in rows if row["robot"] == robot]
        for solver, case in dict.fromkeys((row["solver"], row["case"]) for row in own):
            points = [
                (row["tasks"], row["p50_us"])
                for row in own
                if (row["solver"], row["case"]) == (solver, case)
            ]
            colour = colours.setdefault(solver, f"C{len(colours)}")
            line, label = ("-" if case == "free" else "--"), f"{solver}, {case}"
            axes.semilogy(
                *zip(*points, strict=True), line, color=colour, marker="o", ms=4, label=label
            )
        axes.set_title(f"{robot}, {n} joints", size=10)
        axes.set_xlabel("tasks")
        axes.set_xticks(sorted({row["tasks"] for row in own}))
        axes.grid(which="both", alpha=0.25)
    panels[0].set_ylabel("median time of a call from Python [µs]")
    panels[0].legend(loc="upper left", fontsize=9)
    figure.suptitle(f"{machine['processor']}, kernel {machine['kernel']}", size=10)
    _write(figure, path)


def _write(figure: Any, path: Path) -> None:
    try:
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise ConfigError(
            "--plot", "", str(path), f"cannot be written: {error.strerror}", "Choose another file"
        ) from error
