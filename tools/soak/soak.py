"""`hoap3 soak`: a robot and its controller for hours, and what becomes of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import MetricsSettings
from hoap3.protocol.errors import ConfigError, Hoap3Error, UsageError
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.services.run import run_realtime, transport_words
from hoap3.tools.show.result_folder import unwritable
from hoap3.tools.simulate import suited
from hoap3.tools.soak.draw import draw
from hoap3.tools.soak.judge import judge
from hoap3.tools.soak.watch import Plan, Watch

ROTATED = ("log.cap_mb=64", "log.file_mb=8")
"""So small that the oldest file of a log goes every minute or so, within the warm-up for the first
time: with the sizes of a run nothing would be deleted in an hour and a half."""
RESULT, PICTURE = "soak.json", "soak.png"


def with_metrics() -> str:
    """A setting with which a service serves metrics at a free port."""
    return f"metrics.port={free_port()}"


def soak(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    plan: Plan,
    out: Path | None,
    news: Callable[[dict[str, Any]], None],
    say: Callable[[str], None],
    files: tuple[str, str] = ("config", "config"),
    *,
    should_stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Run both services, watch them, and say what they came to.

    Args:
        emulator, controller: settings of both, with metrics.
        plan: how long.
        out: folder of logs and results, or None for a new one below the configured directory.
        news: takes each piece of news from the services and their observers.
        say: takes how far it is, now and then.
        files: names of both configs, for errors.
        should_stop: as for `run_realtime`.

    Returns:
        What `judge` gives, and `plan`, `failure`, `interrupted`, `machine`, `transport`, `run` (its
        summary, None where it failed), and `files`, what was written.

    Raises:
        Hoap3Error: the robot did not come to move, or the results cannot be written.
    """
    if not emulator.log.record:
        raise ConfigError(
            files[0], "log.record", False, "a soak is of services that record", "Leave it out"
        )
    doors = {
        "robot": _door(emulator.metrics, files[0]),
        "controller": _door(controller.metrics, files[1]),
    }
    _, description = suited(emulator, controller, files)
    watch = Watch(plan, doors, round(description.period_s * 1e9), say)
    places: list[str] = []

    def hear(item: dict[str, Any]) -> None:
        if item["news"] == "begins":
            places.append(item["log"])
        watch.hear(item)
        news(item)

    summary: dict[str, Any] | None = None
    failure = ""
    try:
        summary = run_realtime(
            emulator,
            controller,
            plan.duration_s,
            out,
            hear,
            files,
            should_stop=should_stop,
            meanwhile=watch.look,
        )
    except UsageError:
        raise
    except Hoap3Error as error:  # what ends a service after hours is what a soak is to find
        if not watch.began:
            raise
        failure = str(error)
    result = {
        **judge(watch, plan.warm_up_s, summary, emulator.log.cap_mb * 1_000_000),
        "plan": {"duration_s": plan.duration_s, "warm_up_s": plan.warm_up_s},
        "interrupted": summary is not None and summary["interrupted"],
        "failure": failure,
        "machine": machine_block() if summary is None else summary["machine"],
        "transport": transport_words(emulator.link),
        "run": summary,
    }
    return {**result, "files": [str(path) for path in _write(result, watch, Path(places[0]))]}


def _door(metrics: MetricsSettings, file: str) -> tuple[str, int]:
    """Host and port of the metrics of a service."""
    if metrics.port is None:
        raise ConfigError(
            file, "metrics.port", None, "a soak asks each service for metrics", "Leave it out"
        )
    return metrics.host, metrics.port


def _write(result: dict[str, Any], watch: Watch, folder: Path) -> list[Path]:
    """Write figures and picture into the folder of the logs."""
    report, picture = folder / RESULT, folder / PICTURE
    try:
        with whole_file(report) as draft:
            draft.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        with whole_file(picture) as draft:
            draw(watch, result, draft)
    except OSError as error:
        raise unwritable(folder, error) from error
    return [report, picture]
