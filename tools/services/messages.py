"""Messages between the processes of a run: services, their observers, and what started them.

They go through pipes of processes that we started ourselves, as `multiprocessing` sends them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Generic, TypeVar

from hoap3.protocol.config.settings import MetricsSettings
from hoap3.protocol.runtime.notes import NoteKind
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.services.systemd_notify import NotifySettings

Config = TypeVar("Config", EmulatorConfig, ControllerConfig)


@dataclass(frozen=True)
class ServiceConfig(Generic[Config]):
    """What a service needs to know, in its own process or in that of a command.

    Attributes:
        config: of the emulator or the controller.
        file: where it was read, for errors.
        out: folder of the log; None: a new one below the configured directory.
        duration_s: of the motion [s]; None: until SIGINT or SIGTERM.
        status_fds: pipes for messages of the service, and of its observer, to the process that
            started it; None: they are for people.
        verbose: show people details, too.
    """

    config: Config
    file: str
    out: Path | None = None
    duration_s: float | None = None
    status_fds: tuple[int, int] | None = None
    verbose: bool = False


@dataclass(frozen=True)
class ObserverConfig:
    """What a service gives to the process of its observer.

    Attributes:
        side: "robot" or "controller".
        robot: its name.
        folder: of this run; None to record nothing.
        attachments: texts of files for the log, by name.
        metadata: facts for the log, by group.
        cap_bytes, file_bytes: limits of the whole log, and of one file.
        period_ns: of the robot.
        lockstep: whether stamps are virtual.
        json_lines: whether messages for people are JSON lines on standard output.
        watch: CPUs whose stalls are recorded and count as the host's.
        keep_awake: whether these CPUs are kept from sleeping.
        metrics: where they are served; None: nowhere.
        certificate_ends: Unix time [s] at which the service's certificate ends; None without one.
        notify: where systemd listens; None: nowhere.
        status_fd: pipe for messages to the process that started the service; None: for people.
    """

    side: str
    robot: str
    folder: Path | None
    period_ns: int
    attachments: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    cap_bytes: int = 1_000_000_000
    file_bytes: int = 250_000_000
    lockstep: bool = False
    json_lines: bool = False
    watch: tuple[int, ...] = ()
    keep_awake: bool = False
    metrics: MetricsSettings | None = None
    certificate_ends: float | None = None
    notify: NotifySettings | None = None
    status_fd: int | None = None


@dataclass(frozen=True)
class RunStarts:
    """Both services of a run are started now."""

    robot: str
    endpoints: str
    log: str


@dataclass(frozen=True)
class StatusMessage:
    """Text for people; its kind says how much it matters."""

    text: str
    kind: NoteKind = "said"


@dataclass(frozen=True)
class LoopEvent:
    """An event of a loop, by name, with its text for people; `routine` in the normal course."""

    text: str
    name: str
    routine: bool


@dataclass(frozen=True)
class LiveFigures:
    """Figures of a robot while it runs; see `RunStatistics.live`."""

    figures: dict[str, Any]


@dataclass(frozen=True)
class ServiceFailed:
    """A service ends with an error; `usage` where a setting is wrong."""

    text: str
    usage: bool


@dataclass(frozen=True)
class LogLost:
    """The log is not written any more; `errno` of the operating system, or 0."""

    reason: str
    errno: int


@dataclass(frozen=True)
class MetricsLost:
    """Metrics cannot be served."""

    reason: str


@dataclass(frozen=True)
class ObserverResult:
    """The last message of an observer.

    Attributes:
        side: "robot" or "controller".
        paths: files of the log.
        states: how many it holds.
        figures, counts: of a robot's run, `counts` are the robot's own.
        certificates, outcome: of a controller, `outcome` is its own summary.
    """

    side: str
    paths: tuple[Path, ...] = ()
    states: int = 0
    figures: dict[str, Any] | None = None
    counts: dict[str, Any] = field(default_factory=dict)
    certificates: dict[str, Any] | None = None
    outcome: dict[str, Any] | None = None


Message = RunStarts | StatusMessage | LoopEvent | LiveFigures | ServiceFailed | ObserverResult
OnMessage = Callable[[Message], None]


class MessageSender:
    """Sends messages to a process that may have ended.

    Attributes:
        is_open: whether the other process still reads.
    """

    def __init__(self, fd: int) -> None:
        self._pipe = Connection(fd, readable=False)
        self.is_open = True

    def send(self, message: Message | LogLost | MetricsLost) -> bool:
        """Send one message; whether the other process still reads."""
        if self.is_open:
            try:
                self._pipe.send(message)
            except BrokenPipeError:
                self.is_open = False
        return self.is_open
