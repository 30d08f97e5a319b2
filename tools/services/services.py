"""The two services as commands: config in, observer beside them, an orderly end."""

from __future__ import annotations

import errno
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from hoap3.protocol.config.settings import (
    LogSettings,
    RealtimeSettings,
    Settings,
)
from hoap3.protocol.errors import ConfigError, Hoap3Error, UrdfWarning, UsageError
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.notes import Note, NoteKind, Routine
from hoap3.protocol.runtime.recorder import BlockingRecorder, Recorder, RingRecorder
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.remote_controller.config import ControllerConfig, is_name
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe, serve
from hoap3.tools.analysis.output import COMPILING, CompilationMeter, print_line, watch_compilation
from hoap3.tools.analysis.result_folder import new_name, remove_if_empty
from hoap3.tools.analysis.summary import show_next_of_service
from hoap3.tools.analysis.verdicts import failed, judge_run
from hoap3.tools.logs.log_format import SIDES, file_name
from hoap3.tools.logs.motion_files import LOG_SUFFIX, as_written, attachments_of
from hoap3.tools.logs.pruning import prune
from hoap3.tools.machine.machine import check_extra, machine_block, software
from hoap3.tools.machine.processes import (
    StopFlag,
    check_open_files,
    read_order,
    run_program,
    to_people,
)
from hoap3.tools.services.configs import config_name, load_emulator_config
from hoap3.tools.services.messages import (
    Config,
    MessageSender,
    ObserverConfig,
    ObserverResult,
    ServiceConfig,
    ServiceFailed,
    StatusMessage,
)
from hoap3.tools.services.observer import ObserverHandle
from hoap3.tools.services.placement import settled_alone
from hoap3.tools.services.reporter import OF_NEWS, JsonLines, QueuedLines, facts_of
from hoap3.tools.services.systemd_notify import NotifySettings


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
    file: str = "",
    notify: NotifySettings | None = None,
) -> ObserverHandle:
    """The observer of a service; `report` is called, in a thread, when the log is lost.

    `file` is where the config was read; the log has its name.

    Raises:
        NotInstalledError: metrics could not be served.
        ConfigError: the certificate cannot be used.
    """
    log, metrics, ends = config.log, config.metrics, None
    if metrics.port is not None:
        check_extra("metrics")
        secure = config.link.secure
        ends = None if secure is None else read_credentials(secure).expires.timestamp()
    observer = ObserverConfig(
        side=side,
        robot=robot,
        folder=folder,
        period_ns=period_ns,
        attachments={"config.yaml": as_yaml(config), **_motions(config)},
        metadata={
            "versions": software(),
            "machine": {key: json.dumps(value) for key, value in machine_block().items()},
            "run": {
                "seed": str(getattr(config, "seed", "")),
                "lockstep": str(lockstep).lower(),
                "config": config_name(file),
            },
        },
        cap_bytes=log.cap_mb * 1_000_000,
        file_bytes=log.file_mb * 1_000_000,
        lockstep=lockstep,
        json_lines=log.json_lines is not None and status_fd is None,
        watch=() if lockstep else watched_cpus(config.realtime),
        keep_awake=config.realtime.keep_awake,
        metrics=metrics if metrics.port is not None else None,
        certificate_ends=ends,
        notify=notify,
        status_fd=status_fd,
    )
    return ObserverHandle(observer, report)


def notify_settings(*, alone: bool) -> NotifySettings | None:
    """Where systemd listens to a service that it started; one of a `run` tells it nothing."""
    return NotifySettings.of(os.environ) if alone else None


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
    service: ServiceConfig[EmulatorConfig],
    should_stop: Callable[[], bool],
    *,
    lockstep: bool = False,
) -> tuple[int, dict[str, Any] | None]:
    """Run a robot until it is told to stop.

    Returns:
        Exit code, 0, or 1 after a safe stop, a bad verdict, or where the log was lost or metrics
        could not be served, and the summary as `run` has it; None after a failure. A robot that
        nothing followed is no failure.
    """
    check_open_files()
    if (
        service.status_fds is not None
    ):  # the process that started this one has reported its warnings
        warnings.simplefilter("ignore", UrdfWarning)
    description = describe(service.config, service.file)
    period_ns, duration = round(description.period_s * 1e9), service.duration_s
    ticks = None if duration is None else round(duration * 1e9 / period_ns)
    with closing(StatusReporter(service.status_fds, verbose=service.verbose)) as voice:
        watch_compilation(voice.compiling)
        observed = _observed(service, description.name, voice, period_ns, lockstep=lockstep)
        try:
            with observed as (observer, folder, settled):
                recorder = _recorder(observer, lockstep=lockstep)
                asked = observer.watching(should_stop)
                loop = serve(
                    settled, description, recorder, voice.say, asked, ticks, lockstep=lockstep
                )
        except Hoap3Error as error:
            return voice.fail(error), None
    result, summary = observer.result, None
    if result is not None and result.figures is not None:
        summary = {**judge_run(result.figures, result.counts, None), **result.figures}
        summary["log_lost"] = [observer.lost] if observer.lost else []
        summary["metrics_lost"] = [observer.unserved] if observer.unserved else []
        summary |= told(service.config.link.kind + (", virtual time" if lockstep else ""), folder)
    bad = summary is not None and failed(summary["verdicts"])
    return 1 if loop.safe_stops or bad or observer.lost or observer.unserved else 0, summary


def run_controller(
    service: ServiceConfig[ControllerConfig], should_stop: Callable[[], bool]
) -> int:
    """Run a controller until it is stopped, or has followed its robot for `duration_s`.

    Returns:
        Exit code, 1 where its log or metrics were lost.
    """
    check_open_files()
    from hoap3.remote_controller.service import Service

    on_stop = should_stop.wake if isinstance(should_stop, StopFlag) else None
    config, file = service.config, service.file
    if not is_name(config.robot):
        named = describe(*load_emulator_config(config.robot, [])).name
        service = replace(service, config=config.model_copy(update={"robot": named}))
    with closing(StatusReporter(service.status_fds, verbose=service.verbose)) as voice:
        watch_compilation(voice.compiling)
        observed = _observed(service, service.config.robot, voice, 1_000_000)
        try:
            with observed as (observer, folder, settled):
                one, other = (_recorder(observer, lockstep=lockstep) for lockstep in (False, True))
                robot = _robot_of(settled, file) if settled.link.kind == "hoap3_tcp" else None

                asked = observer.watching(should_stop)
                loop = Service(settled, one, voice.say, asked, file, other, on_stop, robot)
                loop.run(service.duration_s)
        except Hoap3Error as error:
            return voice.fail(error)
        voice.end(folder)
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
    service: ServiceConfig[Config],
    robot: str,
    voice: StatusReporter,
    period_ns: int,
    *,
    lockstep: bool = False,
) -> Iterator[tuple[ObserverHandle, Path | None, Config]]:
    """Observer and log folder of a service, and its config with the CPU that `auto` gets.

    Afterwards the observer has ended, and the CPU is free again. What is refused before anything
    has happened leaves no log, and no folder: a service may be started again every few seconds.
    """
    config, fds = service.config, service.status_fds
    side = "robot" if isinstance(config, EmulatorConfig) else "controller"
    notify = notify_settings(alone=fds is None)
    voice.write_lines(config.log, side, robot)
    folder = run_folder(config.log, service.out, (side,), voice.say)
    claim = None
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
            status_fd=None if fds is None else fds[1],
            report=voice.lost,
            file=service.file,
            notify=notify,
        )
        if fds is not None:
            os.close(fds[1])  # it ends with the observer, however that ends
        refused = False
        try:
            yield observer, folder, config
        except Hoap3Error:
            refused = True
            raise
        finally:
            observer.close()
            if refused and nothing_happened(observer.result):
                forget([observer.result])
    finally:
        if claim is not None:
            claim.release()


def _recorder(observer: ObserverHandle, *, lockstep: bool) -> Recorder:
    if lockstep:
        return BlockingRecorder(observer.ring, observer.alive)
    return RingRecorder(observer.ring)


class StatusReporter:
    """Reports what a service has to say to people, or to the process that started it.

    Args:
        status_fds: pipes to that process, for this one and for its observer; None for people.
        verbose: show people details, too.
    """

    def __init__(self, status_fds: tuple[int, int] | None, *, verbose: bool = False) -> None:
        self.status_fds, self._verbose = status_fds, verbose
        self._meter = CompilationMeter()
        self._sender = None if status_fds is None else MessageSender(os.dup(status_fds[0]))
        self._lines: QueuedLines | None = None
        self._compiled = False
        self._shown = warnings.showwarning

    def write_lines(self, log: LogSettings, side: str, robot: str) -> None:
        """From now on write JSON lines instead, where the settings ask for it; in a `run` never.

        Raises:
            ConfigError: standard output is closed.
        """
        if log.json_lines is None or self.status_fds is not None:
            return
        if sys.stdout is None:  # its number may be another file's
            problem, remedy = "is closed", "Open standard output, or write null"
            raise ConfigError("settings", "log.json_lines", log.json_lines, problem, remedy)
        self._lines = QueuedLines(JsonLines(facts_of(side, robot), to_people))
        warnings.showwarning = self._warn

    def say(self, text: str, kind: NoteKind = "said") -> None:
        """Report text; a `Note` has its own kind."""
        kind = text.news if isinstance(text, Note) else kind
        if self._sender is not None and self._sender.send(StatusMessage(str(text), kind)):
            return
        if kind == "detail" and not self._verbose:
            return
        if self._lines is not None:
            self._lines.write(*OF_NEWS[kind], str(text))
        else:
            to_people(text)

    def compiling(self, kernel: str) -> None:
        """Report that a kernel is being compiled."""
        if self._sender is not None:
            self.say(kernel, "compiling")
        elif self._lines is None:
            self._meter.step(kernel)
        elif not self._compiled:
            self._compiled = True
            self._lines.write(*OF_NEWS["compiling"], COMPILING)

    def end(self, folder: Path | None) -> None:
        """Report the folder of a controller's log; to people on standard output."""
        text = f"log: {folder or 'none'}"
        if self._sender is not None or self._lines is not None:
            self.say(Routine(text))
        else:
            print_line(text)
            show_next_of_service(folder, side="controller")

    def lost(self, text: str) -> None:
        """Report that the log or the metrics of this service are lost."""
        self.say(text, "damaged")

    def fail(self, error: Hoap3Error) -> int:
        """Report what ended the service; its exit code. Without a process to tell, raise again."""
        if self._sender is None:
            if self._lines is not None:
                self._lines.write(*OF_NEWS["failed"], str(error))
            raise error
        usage = isinstance(error, UsageError)
        if not self._sender.send(ServiceFailed(str(error), usage)):
            to_people(f"error: {error}")
        return 2 if usage else 1

    def close(self) -> None:
        """Write what is left of the JSON lines."""
        if self._lines is not None:
            warnings.showwarning = self._shown
            self._lines.close()

    def _warn(self, message: Warning | str, *_: Any, **__: Any) -> None:
        if self._lines is not None:
            self._lines.write("warning", "warning", str(message))


def nothing_happened(result: ObserverResult | None) -> bool:
    """Whether a log holds no State; the log of an observer that died is kept."""
    return result is not None and result.states == 0


def forget(results: Iterable[ObserverResult | None]) -> None:
    """Remove logs of a start that was refused, so that the corrected command can take their place.

    A folder that was made for them is removed at the end of this process: see `remove_if_empty`.

    Args:
        results: of the observers, which have ended.
    """
    for result in results:
        for path in result.paths if result is not None else ():
            path.unlink(missing_ok=True)


def main() -> None:
    """Be the process of a service that `run` starts."""
    stop, service = StopFlag(), read_order()
    if Path(service.file).is_file():  # modules next to a config can be found
        sys.path.append(str(Path(service.file).resolve().parent))
    if isinstance(service.config, EmulatorConfig):
        sys.exit(run_emulator(service, stop)[0])
    sys.exit(run_controller(service, stop))


if __name__ == "__main__":
    run_program(main)
