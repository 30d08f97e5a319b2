"""Motions that the trajectories of a config name: files that logs enclose, or logs as a CSV."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hoap3.protocol.errors import ConfigError, LogError
from hoap3.protocol.messages import schema
from hoap3.remote_controller.config import ControllerConfig
from hoap3.remote_controller.references.trajectories.motion_file import (
    MAX_BYTES,
    column_title,
    read_text,
)
from hoap3.remote_controller.references.trajectories.motion_texts import (
    FILE,
    TEXT,
    trajectories,
    with_texts,
    without_texts,
)
from hoap3.tools.logs.log import Log

ACTIVE = schema("State").constants["ACTIVE"]
Played = Literal["measured", "applied"]


def motion_of(path: Path, played: Played = "measured", every_s: float = 0.01) -> str:
    """A CSV of the joints while the robot followed a controller, from the time 0 on.

    Positions and velocities, of the State's `q` and `dq`, or of its `reference` and what that
    gains within a period. Positions are cut to the joints' ranges, beyond which no reference may
    be, and the last point is at rest.

    Args:
        path: `*.mcap`, or the folder of a run.
        played: which of both.
        every_s: time between the points; the last State is one in any case [s].

    Raises:
        LogError: not a log, or one in which nothing moves the robot for two States.
    """
    log = Log.open(path, side="robot" if path.is_dir() else None)
    states, robot = log.states(), log.description
    states = states[states["mode"] == ACTIVE]
    if len(states) < 2:
        raise LogError(f"{path}: has no two States in which the robot follows. Name another log")
    times = (states["tick"] - states["tick"][0]).astype(float) * robot.period_s
    if played == "measured":
        q, dq = states["q"], states["dq"]
    else:
        q, dq = states["reference"], np.gradient(states["reference"], times, axis=0)
    taken = np.arange(0, len(states), max(1, round(every_s / robot.period_s)))
    if taken[-1] != len(states) - 1:
        taken = np.append(taken, len(states) - 1)
    q, dq = np.clip(q[taken], robot.lower, robot.upper), dq[taken].copy()
    if not np.isfinite(q).all() or not np.isfinite(dq).all():
        raise LogError(f"{path}: joints are not finite in it. Name another log")
    dq[-1] = 0.0
    names = [column_title(name) for name in robot.joint_names]
    header = ["t", *names, *(f"{name}/velocity" for name in names)]
    return _csv(header, np.column_stack([times[taken], q, dq]))


def _csv(header: list[str], table: Any) -> str:
    rows = (",".join(map(repr, row)) for row in table.tolist())
    return "\n".join([",".join(header), *rows, ""])


FOLDER = "motion/"
"""What the name of an enclosed file begins with; the rest is the name in the config."""
LOG_SUFFIX = ".mcap"


def enclosed(config: ControllerConfig, file: str) -> ControllerConfig:
    """The config with the content of the files that its trajectories name; logs become CSV.

    Args:
        config: of a controller.
        file: where it stands; others are sought beside it.

    Raises:
        ConfigError: one cannot be read.
    """
    folder = Path(file).parent

    def text_of(entry: Mapping[str, Any]) -> str:
        path = folder / entry[FILE]
        return _played(path, entry) if is_log(path) else read_text(path)

    return _with(config, with_texts(config.parameters, text_of))


def as_written(config: ControllerConfig) -> ControllerConfig:
    """The config without what `enclosed` added."""
    return _with(config, without_texts(config.parameters))


def attachments_of(config: ControllerConfig) -> dict[str, str]:
    """What a log encloses of an `enclosed` config, by name."""
    found = trajectories(config.parameters)
    return {f"{FOLDER}{each[FILE]}": each[TEXT] for each in found if each.get(TEXT)}


def reopened(content: dict[str, Any], attachments: Mapping[str, bytes]) -> dict[str, Any]:
    """A log's config with the content of the files that the log encloses.

    Settings of how the run was recorded are left out: they have no effect on a replay, and may be
    those of another version.

    Args:
        content: of the config.
        attachments: of the log.

    Raises:
        LogError: one is not there; no file is read on the word of a log.
    """

    def text_of(entry: Mapping[str, Any]) -> str:
        name = f"{FOLDER}{entry[FILE]}"
        if name not in attachments:
            raise LogError(f"the log does not enclose the motion of its config, {name!r:.120}")
        return attachments[name].decode("utf-8", "replace")

    kept = {key: value for key, value in content.items() if key != "log"}
    return {**kept, "parameters": with_texts(content.get("parameters"), text_of)}


def is_log(path: Path) -> bool:
    """Whether it is named like a log, or a folder of some."""
    return path.suffix == LOG_SUFFIX or path.is_dir()


def _played(path: Path, entry: Mapping[str, Any]) -> str:
    played, every_s = entry.get("played", "measured"), entry.get("played_every_s", 0.01)
    if played not in {"measured", "applied"} or not isinstance(every_s, int | float):
        return ""  # which is refused with the other settings
    try:
        text = motion_of(path, played, float(every_s))
    except LogError as error:
        remedy = "Name a log *.mcap, or the folder of a run"
        raise ConfigError("", FILE, entry[FILE], str(error), remedy) from error
    if len(text) > MAX_BYTES:
        problem = f"is larger than {MAX_BYTES >> 20} MiB as a CSV"
        raise ConfigError(str(path), "", None, problem, "Raise played_every_s")
    return text


def _with(config: ControllerConfig, parameters: Any) -> ControllerConfig:
    return config.model_copy(update={"parameters": parameters})
