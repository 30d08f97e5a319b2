"""`hoap3 run`: a robot and its controller, as two processes over Zenoh or in lockstep in one."""

from __future__ import annotations

import os
import pickle
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import LinkSettings, RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.runtime.notes import Note
from hoap3.protocol.runtime.recorder import BlockingRecorder, Recorder
from hoap3.remote_controller.config import ControllerConfig, of_another_robot
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.jerk import jerk_notes
from hoap3.robot_emulator.robots.mimic_limits import mimic_joint_notes
from hoap3.tools.analysis.certificates import CountingRecorder
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.processes import (
    SERVICE_MB,
    Child,
    StopFlag,
    check_memory,
    check_open_files,
    to_people,
)
from hoap3.tools.services.configs import resolve_configs
from hoap3.tools.services.messages import (
    Message,
    ObserverResult,
    OnMessage,
    RunStarts,
    ServiceConfig,
    ServiceFailed,
    StatusMessage,
)
from hoap3.tools.services.observer import ObserverHandle
from hoap3.tools.services.placement import placed
from hoap3.tools.services.services import (
    forget,
    nothing_happened,
    observer_for,
    run_folder,
    told,
    watched_cpus,
)

START_TIMEOUT_S = 120.0  # since the start, or since the newest kernel was compiled
END_TIMEOUT_S = 60.0
MODULE = "hoap3.tools.services.services"  # its argument is for people who list processes


def run_realtime(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    duration: float,
    out: Path | None,
    on_message: OnMessage,
    files: tuple[str, str] = ("config", "config"),
    *,
    links: tuple[dict[str, Any], dict[str, Any]] | None = None,
    should_stop: Callable[[], bool] | None = None,
    meanwhile: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Run both services for `duration` [s] of motion on a free port of this machine.

    Args:
        emulator, controller: settings of both; their links are replaced.
        duration: of the motion [s].
        out: folder of the log, or None for a new one below the configured directory.
        on_message: receives each message of the services and their observers.
        files: names of both configs, for errors.
        links: changes of both links; by default they meet at a free TCP port.
        should_stop: asked now and then; by default SIGINT and SIGTERM end the run.
        meanwhile: called some ten times a second while both services run.

    Returns:
        Its figures, as `run --json` prints them.

    Raises:
        Hoap3Error: a service could not do its work; carries what it said.
    """
    check_open_files()
    check_memory(SERVICE_MB)
    emulator, description = resolve_configs(emulator, controller, files)
    folder = run_folder(emulator.log, out)

    def report(text: str) -> None:
        on_message(StatusMessage(str(text), text.news if isinstance(text, Note) else "said"))

    here, there = links or _meeting(emulator)
    emulator = emulator.model_copy(update={"link": emulator.link.model_copy(update=here)})
    if emulator.link.kind == "hoap3_tcp":  # which does not tell the robot's description
        ports = emulator.link.hoap3_tcp.model_copy(update={"robot": emulator.robot})
        there = {**there, "hoap3_tcp": ports}
    endpoints = ", ".join(emulator.link.places)
    on_message(RunStarts(description.name, endpoints, str(folder) if folder else "none"))
    ours, theirs, claims = placed(emulator.realtime, controller.realtime, report)
    ours, theirs = _watched(ours, theirs)
    emulator = emulator.model_copy(update={"realtime": ours})
    hint = of_another_robot(controller, description)
    controller = controller.model_copy(
        update={
            "robot": description.name,
            "link": controller.link.model_copy(update=there),
            "realtime": theirs,
            "log": emulator.log,
        }
    )
    work = _Services(on_message, should_stop or StopFlag())
    try:
        work.start("emulator", ServiceConfig(emulator, files[0], folder, duration))
        work.start("controller", ServiceConfig(controller, files[1], folder))
        summary = work.watch(duration, meanwhile)
    except UsageError as error:
        if hint and work.failed == "controller":
            raise UsageError(f"{error}. {hint}") from error
        raise
    finally:
        work.stop()
        if work.refused:
            forget(work.results.values())
        for claim in claims:
            claim.release()
    return summary | told(transport_words(emulator.link), folder)


def transport_words(link: LinkSettings) -> str:
    """How both sides of a run reach each other."""
    protocol = "tcp" if link.secure is None else "tls"
    return f"{f'zenoh {protocol}' if link.kind == 'zenoh' else link.kind}, same host"


def _meeting(emulator: EmulatorConfig) -> tuple[dict[str, Any], dict[str, Any]]:
    """Changes of both links, with which robot and controller meet at free ports."""
    if emulator.link.kind == "zenoh":
        protocol = "tcp" if emulator.link.secure is None else "tls"
        endpoint = f"{protocol}/127.0.0.1:{free_port()}"
        return {"listen": (endpoint,)}, {"connect": (endpoint,), "kind": "zenoh"}
    ports = {"host": "127.0.0.1", "init_port": free_port(), "control_port": free_port()}
    ours = emulator.link.hoap3_tcp.model_copy(update=ports)
    return {"hoap3_tcp": ours}, {"kind": "hoap3_tcp"}


def run_lockstep(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    duration: float,
    out: Path | None,
    files: tuple[str, str] = ("config", "config"),
    *,
    should_stop: Callable[[], bool] | None = None,
    report: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Run both in this process on virtual time; arguments as for `run_realtime`.

    `report` takes how many ticks are done, of how many.
    """
    from hoap3.tools.services.simulate import Lockstep

    check_open_files()
    emulator, description = resolve_configs(emulator, controller, files)
    for note in (*mimic_joint_notes(description), *jerk_notes(description)):
        to_people(note)
    folder, refused = run_folder(emulator.log, out), False
    observers: dict[str, ObserverHandle] = {}
    unlogged = CountingRecorder()

    def recorder_for(side: str, config: EmulatorConfig | ControllerConfig) -> Recorder:
        if folder is None and side == "controller":
            return unlogged
        observer = observer_for(
            side,
            description.name,
            config,
            folder,
            period_ns=round(description.period_s * 1e9),
            lockstep=True,
            status_fd=silence.fileno(),
            report=to_people,
            file=files[side == "controller"],
        )
        observers[side] = observer
        return BlockingRecorder(observer.ring, observer.alive)

    try:
        with Path(os.devnull).open("w") as silence:  # events in virtual time go to the log only
            robot_log = recorder_for("robot", emulator)
            controller_log = recorder_for("controller", controller)
        lockstep = Lockstep(emulator, controller, robot_log, controller_log, files=files)
        for note in (*lockstep.robot.plant.notes(), *lockstep.controller.notes()):
            to_people(note)
        began = time.monotonic()
        lockstep.run(duration, should_stop or (lambda: False), report)
        wall = time.monotonic() - began
        if lockstep.controller_loop.not_finite:
            to_people(lockstep.controller_loop.not_finite)
    except Hoap3Error:
        refused = True
        raise
    finally:
        for observer in observers.values():
            observer.close()
        results = {side: observer.result for side, observer in observers.items()}
        if refused and all(map(nothing_happened, results.values())):
            forget(results.values())
    lost = [observer.lost for observer in observers.values() if observer.lost]
    robot = results["robot"]
    if robot is None or robot.figures is None or None in results.values():
        raise Hoap3Error("; ".join(lost))
    controlled = results.get("controller") or ObserverResult(
        "controller", certificates=unlogged.count.figures(), outcome=unlogged.outcome
    )
    summary = _merge_results(robot, robot.figures, controlled)
    summary["log_lost"] = lost
    summary["metrics_lost"] = [o.unserved for o in observers.values() if o.unserved]
    summary["lockstep"] = {
        "wall_s": wall,
        "times_real_time": (lockstep.robot.tick + 1) * description.period_s / wall,
    }
    if folder is not None and not lost:
        summary["payload_sha256"] = {
            side: payload_hash(Log.open(folder, side=side)) for side in ("robot", "controller")
        }
    interrupted = should_stop is not None and should_stop()
    summary |= {"interrupted": interrupted, "duration_s": duration}
    return summary | told("in process, virtual time", folder)


class _Services:
    """Both services as children, and their messages."""

    def __init__(self, on_message: OnMessage, should_stop: Callable[[], bool]) -> None:
        self._on_message, self._stop = on_message, should_stop
        self._children: dict[str, Child] = {}
        self._pipes: dict[Connection, str] = {}
        self.last_text, self.progressed = "", 0.0
        self.failure: Hoap3Error | None = None
        self.failed = ""  # the one that failed
        self.results: dict[str, ObserverResult] = {}  # of both observers
        self.damage: list[str] = []  # why logs are not whole
        self.unserved: list[str] = []  # why metrics are not served

    def start(self, name: str, service: ServiceConfig[Any]) -> None:
        """Start a service."""
        pipes = os.pipe(), os.pipe()  # one writer each: a killed one ends its pipe
        for reader, _ in pipes:
            self._pipes[Connection(reader, writable=False)] = name
        writers = pipes[0][1], pipes[1][1]
        try:
            order = replace(service, status_fds=writers)
            self._children[name] = Child([MODULE, name], order, writers)
        finally:
            for writer in writers:
                os.close(writer)

    def watch(self, duration: float, meanwhile: Callable[[], None]) -> dict[str, Any]:
        """The summary, once the robot has ended its motion, or somebody has ended it."""
        self.progressed, patience = time.monotonic(), START_TIMEOUT_S + 2 * duration
        emulator, controller = self._children["emulator"], self._children["controller"]
        while emulator.poll() is None and controller.poll() is None:
            self._listen(0.1)
            meanwhile()
            if self._stop():
                break
            if time.monotonic() > self.progressed + patience:
                raise Hoap3Error(self._failure("the run did not begin, or did not end, in time"))
        failed = controller.poll() is not None and emulator.poll() is None and not self._stop()
        self.stop()
        if self.failure is not None:
            raise self.failure
        robot = self.results.get("robot", ObserverResult("robot"))
        if self._stop() and not (robot.figures and robot.figures["ticks"]):
            raise Hoap3Error("interrupted before the motion began")
        if failed:
            raise Hoap3Error(self._failure("the controller ended before the robot did"))
        if emulator.returncode < 0:
            number = -emulator.returncode
            raise Hoap3Error(f"the robot was killed by signal {number}: its count is not whole")
        if robot.figures is None:
            without = self._failure("the robot ended without a summary")
            raise Hoap3Error("; ".join(self.damage) or without)
        controller_result = self.results.get("controller", ObserverResult("controller"))
        return {
            **_merge_results(robot, robot.figures, controller_result),
            "log_lost": self.damage,
            "metrics_lost": self.unserved,
            "interrupted": self._stop(),
            "duration_s": duration,
        }

    def stop(self) -> None:
        """End both, the robot first: it comes to rest while its controller still answers."""
        for child in (self._children.get("emulator"), self._children.get("controller")):
            if child is None:
                continue
            if child.poll() is None:
                child.send_signal(signal.SIGTERM)
            limit = time.monotonic() + END_TIMEOUT_S
            while child.poll() is None and time.monotonic() < limit:
                self._listen(0.05)
            child.end(0.0)
        while self._listen(0.0):
            pass

    @property
    def refused(self) -> bool:
        """Whether a service failed, or was stopped, before a State had reached the controller."""
        result = self.results.get("controller", ObserverResult("controller"))
        robot = self.results.get("robot", ObserverResult("robot"))
        interrupted = self._stop() and not (robot.figures or {}).get("ticks")
        return (interrupted or self.failure is not None) and nothing_happened(result)

    def _listen(self, timeout: float) -> bool:
        """Receive one message of each service that has sent some; whether there were any."""
        ready = wait(list(self._pipes), timeout)
        for pipe in ready:
            if isinstance(pipe, Connection):
                try:
                    message: Message = pipe.recv()
                except (EOFError, OSError, pickle.UnpicklingError):
                    del self._pipes[pipe]
                    pipe.close()
                else:
                    self._receive(message, self._pipes[pipe])
        return bool(ready)

    def _receive(self, message: Message, service: str) -> None:
        match message:
            case StatusMessage():
                if message.kind == "compiling":
                    self.progressed = time.monotonic()
                else:
                    self.last_text = message.text
                if message.kind == "damaged":
                    self.damage.append(message.text)
                elif message.kind == "unserved":
                    self.unserved.append(message.text)
            case ServiceFailed() if self.failure is None:
                self.failure = (UsageError if message.usage else Hoap3Error)(message.text)
                self.failed = service
            case ObserverResult():
                self.results[message.side] = message
        self._on_message(message)

    def _failure(self, what: str) -> str:
        return f"{what}; last heard: {self.last_text}" if self.last_text else what


def _merge_results(
    robot: ObserverResult, figures: dict[str, Any], controller: ObserverResult
) -> dict[str, Any]:
    """Figures and verdicts of a run, from what the observers of both sides have counted."""
    theirs = controller.certificates
    if figures["certificates"] and theirs:
        figures["certificates"]["reasons"] = theirs["reasons"]
    return {**judge_run(figures, robot.counts, controller.outcome, expected=True), **figures}


def _watched(
    robot: RealtimeSettings, controller: RealtimeSettings
) -> tuple[RealtimeSettings, RealtimeSettings]:
    """Settings of both sides: the robot's observer watches the CPUs of both."""
    watched = {*watched_cpus(robot), *watched_cpus(controller)}
    if robot.watch_stalls == "none" or not watched:
        return robot, controller.model_copy(update={"watch_stalls": "none"})
    return (
        robot.model_copy(update={"watch_stalls": tuple(sorted(watched))}),
        controller.model_copy(update={"watch_stalls": "none"}),
    )
