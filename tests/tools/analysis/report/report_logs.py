"""Logs to report on: a real one in lockstep, a made-up one in real time, and hostile ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from support.log_samples import MS, START, fill, write
from support.log_samples import describe as chain
from support.tick_story import Story

from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record


def lockstep_run(folder: Path) -> tuple[Path, dict]:
    """Half a second of HOAP-3 with QP12."""
    from hoap3.tools.services.configs import load_controller_config, load_emulator_config
    from hoap3.tools.services.run import run_lockstep

    emulator, _ = load_emulator_config("hoap3", [])
    controller, _ = load_controller_config("qp12", [])
    summary = run_lockstep(emulator, controller, 0.5, folder / "run")
    return folder / "run", summary


def story_run(folder: Path) -> tuple[Path, Story]:
    """Six hundred ticks: slow solves, lost answers, skipped ticks, stalls that somebody watched.

    One of the stalls was over before the first tick.
    """
    story = Story(
        600,
        stalls=[(300 * MS, 4 * MS), (450 * MS, MS // 2), (-50 * MS, MS)],
        skipped={302, 303},
        vanished={120, 121, 122, 123, 124},
    )
    story.slow("solve", [200, 400], 2000.0)
    return story.write(folder), story


def active_log(
    folder: Path,
    *,
    count: int = 50,
    description: RobotDescription | None = None,
    events: tuple[tuple[int, int], ...] = (),
    state: dict | None = None,
    setpoint: dict | Callable[[int], dict] | None = None,
    **options,
) -> Path:
    """A robot's log of active ticks with random joint positions.

    Args:
        events: pairs of kind and detail.
        state, setpoint: fields of every such message; of setpoints, also by their tick.
        options: of the log writer.
    """
    description = description or chain(2)
    n, rng = description.n, np.random.default_rng(1)
    records = [
        Record(Kind.DESCRIPTION, START - 2, description.to_json()),
        Record(Kind.SESSION, START - 1, json.dumps({"session_id": 7, "lockstep": False}).encode()),
    ]
    same = {"session_id": 7, "epoch": 1, "skipped": 0}
    same |= dict.fromkeys(("late", "lost", "rejected", "duplicate", "out_of_order"), 0)
    for tick in range(count):
        at = START + tick * MS
        given = {
            **same,
            "tick": tick,
            "mode": State.ACTIVE,
            "stamp_intended": at,
            "stamp_actual": at + 5,
            "stamp_published": at + 9,
            **(state or {}),
        }
        records.append(Record(Kind.STATE, at + 9, fill(State(n), rng, **given)))
        fields = setpoint(tick) if callable(setpoint) else setpoint or {}
        given = {**same, "tick": tick, "stamp_state": at + 9, "command": 0}
        given |= {"kkt_residual": 0.0, **fields}
        records.append(Record(Kind.SETPOINT, at + 99, fill(Setpoint(n), rng, **given)))
    for place, (kind, detail) in enumerate(events):
        event, at = Event(), START + place
        event.kind, event.detail, event.session_id, event.stamp = kind, detail, 7, at
        records.append(Record(Kind.EVENT, at, event.dump()))
    about = {"attachments": {"description.json": description.to_json()}, **options}
    write(folder / "robot.mcap", records, **about)
    return folder
