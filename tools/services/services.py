"""The two services as commands: config in, observer beside them, an orderly end."""

from __future__ import annotations

import errno
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import yaml

from hoap3.protocol.config.settings import (
    LogSettings,
    MetricsSettings,
    RealtimeSettings,
    Settings,
    apply_overrides,
    parse,
    parse_yaml,
)
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError, Hoap3Error, UrdfWarning, UsageError
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.protocol.runtime.notes import Note, Routine
from hoap3.protocol.runtime.recorder import BlockingRecorder, Recorder, RingRecorder
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.remote_controller.config import ControllerConfig, check_parameters, is_name
from hoap3.remote_controller.config import read_config as read_controller_config
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe, serve, serve_lockstep
from hoap3.tools.logs.log_format import SIDES, file_name
from hoap3.tools.logs.motion_files import LOG_SUFFIX, as_written, attachments_of, enclosed
from hoap3.tools.logs.pruning import prune
from hoap3.tools.machine.extras import check_metrics
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.machine.processes import StopFlag, check_open_files, to_people
from hoap3.tools.machine.sd_notify import NotifySettings
from hoap3.tools.machine.software import software
from hoap3.tools.services.monitoring.json_lines import (
    MB,
    OF_NEWS,
    JsonLines,
    QueuedLines,
    facts_of,
)
from hoap3.tools.services.observer import ObserverHandle
from hoap3.tools.services.placement import settled_alone
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import Meter, print_line
from hoap3.tools.show.refusal import forget, is_new, nothing_happened
from hoap3.tools.show.result_folder import new_name, remove_if_empty
from hoap3.tools.show.verdicts import failed
from hoap3.tools.simulate import emulator_content

COMPILING = "compiling kernels, once for each version"
NO_REALTIME = {"policy": "none", "cpu": "none", "lock_memory": False}


STANDARD_INPUT = "-"

Config = TypeVar("Config", EmulatorConfig, ControllerConfig)


def emulator_config(
    name: str, overrides: list[str], *, realtime: bool = True, named: str | None = None
) -> tuple[EmulatorConfig, str]:
    """Settings of an emulator: a config or a robot, changed by `--set`, and where it was read.

    Args:
        name: a shipped config, a robot, a file, or `-` for standard input.
        overrides: `dotted.key=value`, each.
        realtime: False for an ordinary process.
        named: what errors call it.
    """
    given = _piped(named) if name == STANDARD_INPUT else emulator_content(name)
    return _changed(EmulatorConfig, given, overrides, realtime=realtime)[0], given[1]


def controller_config(
    name: str, overrides: list[str], *, realtime: bool = True, named: str | None = None
) -> tuple[ControllerConfig, str]:
    """Settings of a controller, its parameters checked; arguments as for `emulator_config`."""
    given = _piped(named) if name == STANDARD_INPUT else read_controller_config(name)
    config, label = _changed(ControllerConfig, given, overrides, realtime=realtime)
    config = enclosed(config, given[1])
    check_parameters(config, label)
    return config, given[1]


def _changed(
    model: type[Config], given: tuple[dict[str, Any], str], overrides: list[str], *, realtime: bool
) -> tuple[Config, str]:
    """Settings as `--set` and `--no-realtime` change them, and what errors call them."""
    content, file = apply_overrides(given[0], overrides), given[1]
    label = f"{file} with --set" if overrides else file
    given_realtime = content.get("realtime", {})
    if not realtime and isinstance(given_realtime, dict):  # else it is refused below
        content["realtime"] = {**given_realtime, **NO_REALTIME}
    return parse(model, content, label), label


def split_overrides(overrides: list[str]) -> tuple[list[str], list[str]]:
    """Overrides of a run: those for the emulator, and those for the controller.

    Raises:
        ConfigError: one begins with neither name.
    """
    sides: dict[str, list[str]] = {"emulator": [], "controller": []}
    for override in overrides:
        side, _, rest = override.partition(".")
        if side not in sides:
            raise ConfigError(
                "--set",
                override.partition("=")[0],
                override,
                "belongs to neither side",
                "Begin with `emulator.` or `controller.`",
            )
        sides[side].append(rest)
    return sides["emulator"], sides["controller"]


def _piped(named: str | None) -> tuple[dict[str, Any], str]:
    """Settings from standard input; modules beside the file that they came from can be found."""
    file = named or "standard input"
    content = parse_yaml(sys.stdin.read(), file)
    if named is not None and Path(named).is_file():
        sys.path.append(str(Path(named).resolve().parent))
    return content, file


def run_folder(
    log: LogSettings,
    out: Path | None = None,
    sides: Sequence[str] = SIDES,
    say: Callable[[str], None] = to_people,
) -> Path | None:
    """A new folder for the log of one run, or None where nothing is recorded.

    Old runs beside it go where the settings say so.

    Args:
        log: where, and whether.
        out: the folder itself, as `--out` names it; it may exist.
        sides: those whose logs will be written there.
        say: takes what became of old runs.

    Raises:
        ConfigError: the folder cannot be made or written, holds such a log already, or has the name
            of a file.
    """
    if not log.record:
        return None
    folder = out or new_name(Path(log.directory))
    _prune(log, folder, say)  # before anything new needs room
    try:
        if folder.suffix == LOG_SUFFIX:
            raise NotADirectoryError(errno.ENOTDIR, "is the name of a log, not of its folder")
        remove_if_empty(folder)
        folder.mkdir(parents=True, exist_ok=out is not None)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        for name in (file_name(side, 0) for side in sides):
            if (folder / name).exists():
                raise FileExistsError(errno.EEXIST, f"holds {name} already")
    except OSError as error:
        raise ConfigError(
            "settings" if out is None else "--out",
            "log.directory" if out is None else "",
            str(out or log.directory),
            error.strerror or "cannot be made",
            "Name a new folder that can be written, or set log.record=false",
        ) from error
    return folder


def _prune(log: LogSettings, spare: Path, say: Callable[[str], None]) -> None:
    """Delete old runs, as far as the settings say so."""
    pruned = prune(
        Path(log.directory),
        now=time.time(),
        keep_days=log.keep_days,
        keep_mb=log.keep_mb,
        spare=spare,
    )
    if str(pruned):
        say(f"{log.directory}: {pruned}")


def observer_for(
    side: str,
    robot: str,
    config: EmulatorConfig | ControllerConfig,
    folder: Path | None,
    *,
    period_ns: int,
    lockstep: bool,
    status_fd: int | None,
    report: Callable[[str], None],
    notify: NotifySettings | None = None,
) -> ObserverHandle:
    """The observer of a service; `report` is told, in a thread, when the log is lost."""
    log = config.log
    order = {
        "side": side,
        "robot": robot,
        "directory": str(folder) if folder else None,
        "attachments": {"config.yaml": as_yaml(config), **_motions(config)},
        "metadata": {
            "versions": software(),
            "machine": {key: json.dumps(value) for key, value in machine_block().items()},
            "run": {"seed": str(getattr(config, "seed", "")), "lockstep": str(lockstep).lower()},
        },
        "limits": (log.cap_mb * 1_000_000, log.file_mb * 1_000_000),
        "json_lines": _lines_order(log) if status_fd is None else None,
        "period_ns": period_ns,
        "lockstep": lockstep,
        "watch": () if lockstep else watched_cpus(config.realtime),
        "keep_awake": config.realtime.keep_awake,
        "status_fd": status_fd,
        "notify": asdict(notify) if notify else None,
        "metrics": _metrics(config.metrics, config.link.secure),
    }
    return ObserverHandle(order, report)


def _lines_order(log: LogSettings) -> dict[str, Any] | None:
    """Where an observer writes JSON lines; one of a `run` writes none, as it is no service."""
    if log.json_lines is None:
        return None
    return {"place": log.json_lines, "most_bytes": log.json_lines_mb * MB}


def _metrics(metrics: MetricsSettings, secure: str | None) -> dict[str, Any] | None:
    """Where figures are to be served, and when the certificate in a folder ends; None: nowhere.

    Raises:
        NotInstalledError: they could not be.
        ConfigError: the certificate cannot be used.
    """
    if metrics.port is None:
        return None
    check_metrics()
    ends = None if secure is None else read_credentials(secure).expires.timestamp()
    return {**metrics.model_dump(), "certificate_ends": ends}


def notify_settings(status_fd: int | None) -> NotifySettings | None:
    """Where systemd listens to a service that it started; one of a `run` tells it nothing."""
    return NotifySettings.of(os.environ) if status_fd is None else None


def watched_cpus(realtime: RealtimeSettings) -> tuple[int, ...]:
    """CPUs whose stalls are noted: with ordinary priority they cannot be told from load."""
    if isinstance(realtime.watch_stalls, tuple):
        return realtime.watch_stalls
    watch = realtime.watch_stalls == "auto" and realtime.policy == "auto"
    return (realtime.cpu,) if watch and isinstance(realtime.cpu, int) else ()


def as_yaml(config: Settings) -> str:
    """The resolved whole, as a config file that can be used again."""
    if isinstance(config, ControllerConfig):
        config = as_written(config)
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True)


def _motions(config: Settings) -> dict[str, str]:
    return attachments_of(config) if isinstance(config, ControllerConfig) else {}


def told(transport: str, folder: Path | None) -> dict[str, Any]:
    """What every summary says of the circumstances of its run."""
    log = str(folder) if folder else None
    return {"machine": machine_block(), "transport": transport, "log": log}


def run_emulator(
    config: EmulatorConfig,
    file: str,
    *,
    lockstep: bool,
    duration: float | None,
    out: Path | None,
    status_fd: int | None,
    should_stop: Callable[[], bool],
    verbose: bool = False,
) -> tuple[int, dict[str, Any] | None]:
    """Run a robot until it is told to stop.

    Returns:
        Exit code, 0, or 1 after a safe stop, a bad verdict, or where the log was lost or metrics
        could not be served, and the summary as `run` has it; None after a failure. A robot that
        nothing followed is no failure.
    """
    check_open_files()
    if status_fd is not None:  # who started us has read the robot, too, and has said what it found
        warnings.simplefilter("ignore", UrdfWarning)
    description = describe(config, file)
    period_ns = round(description.period_s * 1e9)
    ticks = None if duration is None else round(duration * 1e9 / period_ns)
    run = serve_lockstep if lockstep else serve
    name = description.name
    with closing(StatusReporter(status_fd, verbose=verbose)) as voice:
        watch_compilation(voice.compiling)
        observed = _observed("robot", name, config, out, voice, period_ns, lockstep=lockstep)
        try:
            with observed as (observer, folder, settled):
                recorder = _recorder(observer, lockstep=lockstep)
                asked = observer.watching(should_stop)
                loop = run(settled, description, recorder, voice.say, asked, ticks)
        except Hoap3Error as error:
            return voice.fail(error), None
    summary = observer.final.get("summary")
    if summary is not None:
        summary["log_lost"] = [observer.lost] if observer.lost else []
        summary["metrics_lost"] = [observer.unserved] if observer.unserved else []
        summary |= told(config.link.kind + (", virtual time" if lockstep else ""), folder)
    bad = summary is not None and failed(summary["verdicts"])
    return 1 if loop.safe_stops or bad or observer.lost or observer.unserved else 0, summary


def run_controller(
    config: ControllerConfig,
    file: str,
    *,
    out: Path | None,
    status_fd: int | None,
    should_stop: Callable[[], bool],
    verbose: bool = False,
    duration: float | None = None,
) -> int:
    """Run a controller until it is stopped, or has followed its robot for `duration` [s].

    Returns:
        Exit code, 1 where its log or metrics were lost.
    """
    check_open_files()
    from hoap3.remote_controller.service import Service

    on_stop = should_stop.wake if isinstance(should_stop, StopFlag) else None
    if not is_name(config.robot):
        named = describe(*emulator_config(config.robot, [])).name
        config = config.model_copy(update={"robot": named})
    with closing(StatusReporter(status_fd, verbose=verbose)) as voice:
        watch_compilation(voice.compiling)
        observed = _observed("controller", config.robot, config, out, voice, 1_000_000)
        try:
            with observed as (observer, folder, settled):
                one, other = (_recorder(observer, lockstep=lockstep) for lockstep in (False, True))
                robot = _robot_of(settled, file) if settled.link.kind == "hoap3_tcp" else None

                asked = observer.watching(should_stop)
                service = Service(settled, one, voice.say, asked, file, other, on_stop, robot)
                service.run(duration)
        except Hoap3Error as error:
            return voice.fail(error)
        voice.result(f"log: {folder or 'none'}")
    return 1 if observer.lost or observer.unserved else 0


def _robot_of(config: ControllerConfig, file: str) -> RobotDescription:
    """What HOAP-3's protocol does not tell of the robot: its description from a file.

    Raises:
        ConfigError: it cannot be read, or does not fit the protocol.
    """
    settings, key = config.link.hoap3_tcp, "link.hoap3_tcp"
    for port in ("init_port", "control_port"):
        if not getattr(settings, port):
            raise ConfigError(
                file, f"{key}.{port}", 0, "is no port of a robot", "Write the robot's"
            )
    remedy = "Name the robot that is there"
    try:
        description = load(settings.robot)
        Frames(description, settings.slots)
    except UsageError as error:
        raise ConfigError(file, f"{key}.robot", settings.robot, str(error), remedy) from error
    if "position" not in description.command_kinds:
        takes = " or ".join(description.command_kinds)
        problem = f"carries positions, and this robot takes {takes}"
        raise ConfigError(file, f"{key}.robot", settings.robot, problem, remedy)
    return description.model_copy(update={"command_kinds": ("position",)})


@contextmanager
def _observed(
    side: str,
    robot: str,
    config: Config,
    out: Path | None,
    voice: StatusReporter,
    period_ns: int,
    *,
    lockstep: bool = False,
) -> Iterator[tuple[ObserverHandle, Path | None, Config]]:
    """Observer and log folder of a service, and its config with the CPU that `auto` gets.

    Afterwards the observer has ended, and the CPU is free again. What is refused before anything
    has happened leaves no log, and no folder: a service may be started again every few seconds.
    """
    notify = notify_settings(voice.status_fd)
    voice.write_lines(config.log, side, robot)
    made, folder = is_new(out), run_folder(config.log, out, (side,), voice.say)
    claim = None
    try:
        try:
            if not lockstep:
                realtime, claim = settled_alone(config.realtime, side, voice.say)
                config = config.model_copy(update={"realtime": realtime})
            observer = observer_for(
                side,
                robot,
                config,
                folder,
                period_ns=period_ns,
                lockstep=lockstep,
                status_fd=voice.status_fd,
                report=voice.lost,
                notify=notify,
            )
        except (Hoap3Error, OSError):
            forget((), folder, made=made)
            raise
        refused = False
        try:
            yield observer, folder, config
        except Hoap3Error:
            refused = True
            raise
        finally:
            observer.close()
            if refused and nothing_happened(observer.final):
                forget([observer.final], folder, made=made)
    finally:
        if claim is not None:
            claim.release()


def _recorder(observer: ObserverHandle, *, lockstep: bool) -> Recorder:
    if lockstep:
        return BlockingRecorder(observer.ring, observer.alive)
    return RingRecorder(observer.ring)


class StatusReporter:
    """Tells people, or the process that started us, what a service has to say.

    Args:
        status_fd: pipe to that process, shared with the observer; None for people.
        verbose: show people details, too.
    """

    def __init__(self, status_fd: int | None, *, verbose: bool = False) -> None:
        self.status_fd, self._verbose = status_fd, verbose
        self._meter = Meter(COMPILING, None)
        self._stream = None if status_fd is None else os.fdopen(os.dup(status_fd), "w")
        self._lines: QueuedLines | None = None
        self._quiet = self._compiled = False
        self._shown = warnings.showwarning

    def write_lines(self, log: LogSettings, side: str, robot: str) -> None:
        """From now on write JSON lines, too, where the settings say so; in a `run` never.

        Raises:
            ConfigError: they cannot be written there.
        """
        if log.json_lines is None or self.status_fd is not None:
            return
        lines = JsonLines(log.json_lines, facts_of(side, robot), to_people)
        try:
            lines.open()
        except OSError as error:
            problem = f"cannot be written: {error.strerror}"
            remedy = "Name a file in a folder that is there, stdout, or null"
            raise ConfigError(
                "settings", "log.json_lines", log.json_lines, problem, remedy
            ) from error
        self._lines, self._quiet = QueuedLines(lines), log.tells_json
        warnings.showwarning = self._warn

    def say(self, text: str, news: str = "said") -> None:
        """Something to know; of which kind, for the process that started us."""
        kind = text.news if isinstance(text, Note) else news
        if self._stream is not None or kind != "detail" or self._verbose:
            self._send({"news": kind, "text": text})

    def compiling(self, kernel: str) -> None:
        """Tell that a kernel is being compiled."""
        if self._stream is not None:
            self.say(kernel, news="compiling")
            return
        if self._lines is not None and not self._compiled:
            self._compiled = True
            self._lines.write(*OF_NEWS["compiling"], COMPILING)
        if not self._quiet:
            self._meter.step(kernel)

    def result(self, text: str) -> None:
        """What the service leaves; to people on standard output."""
        if self._stream is not None or self._quiet:
            self.say(Routine(text))
            return
        print_line(text)
        if self._lines is not None:
            self._lines.write(*OF_NEWS["routine"], text)

    def lost(self, text: str) -> None:
        """The log of this service is lost."""
        self.say(text, news="damaged")

    def fail(self, error: Hoap3Error) -> int:
        """Tell what ended the service; its exit code. With nobody to tell, raise it again."""
        usage = isinstance(error, UsageError)
        if self._stream is None:
            if self._lines is not None:
                self._lines.write(*OF_NEWS["failed"], str(error))
            raise error
        self._send({"news": "failed", "text": str(error), "usage": usage})
        return 2 if usage else 1

    def close(self) -> None:
        """Write what is left of the JSON lines."""
        if self._lines is not None:
            warnings.showwarning = self._shown
            self._lines.close()

    def _warn(self, message: Warning | str, *about: Any, **more: Any) -> None:
        if self._lines is not None:
            self._lines.write("warning", "warning", str(message))
        if not self._quiet:
            self._shown(message, *about, **more)

    def _send(self, item: dict[str, Any]) -> None:
        if self._lines is not None:
            self._lines.write(*OF_NEWS[item["news"]], str(item["text"]))
        try:
            if self._stream is not None:
                self._stream.write(json.dumps(item) + "\n")
                self._stream.flush()
                return
        except BrokenPipeError:  # whoever started us is gone
            self._stream = None
        if not self._quiet:
            to_people(item["text"])
