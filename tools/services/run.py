"""`hoap3 run`: a robot and its controller, as two processes over Zenoh or in lockstep in one."""

from __future__ import annotations

import json
import os
import selectors
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import LinkSettings, RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.runtime.deadline_verdict import FAIL, NOT_JUDGED
from hoap3.protocol.runtime.notes import Note
from hoap3.protocol.runtime.recorder import BlockingRecorder, Recorder
from hoap3.remote_controller.config import ControllerConfig, of_another_robot
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.jerk import jerk_notes
from hoap3.robot_emulator.robots.follower_limits import follower_notes
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.processes import Child, StopFlag, check_open_files, to_people
from hoap3.tools.services.observer import ObserverHandle
from hoap3.tools.services.placement import placed
from hoap3.tools.services.services import as_yaml, observer_for, run_folder, told, watched_cpus
from hoap3.tools.show.certificate_count import CountingRecorder
from hoap3.tools.show.refusal import forget, is_new, nothing_happened
from hoap3.tools.show.verdicts import judge
from hoap3.tools.simulate import suited

START_TIMEOUT_S = 120.0  # the first start on a machine compiles the kernels
END_TIMEOUT_S = 60.0

News = Callable[[dict[str, Any]], None]


def run_realtime(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    duration: float,
    out: Path | None,
    news: News,
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
        news: takes each piece of news from the services and their observers.
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
    emulator, description = suited(emulator, controller, files)
    made, folder = is_new(out), run_folder(emulator.log, out)

    def report(text: str) -> None:
        news({"news": text.news if isinstance(text, Note) else "said", "text": text})

    here, there = links or _meeting(emulator)
    emulator = emulator.model_copy(update={"link": emulator.link.model_copy(update=here)})
    if emulator.link.kind == "hoap3_tcp":  # which does not tell the robot's description
        ports = emulator.link.hoap3_tcp.model_copy(update={"robot": emulator.robot})
        there = {**there, "hoap3_tcp": ports}
    news(
        {
            "news": "begins",
            "robot": description.name,
            "at": ", ".join(emulator.link.places),
            "log": str(folder) if folder else "none",
        }
    )
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
    work = _Services(news, should_stop or StopFlag())
    try:
        work.start("emulator", as_yaml(emulator), files[0], folder, duration)
        work.start("controller", as_yaml(controller), files[1], folder, None)
        summary = work.watch(duration, meanwhile)
    except UsageError as error:
        if hint and work.failed == "controller":
            raise UsageError(f"{error}. {hint}") from error
        raise
    finally:
        work.stop()
        if work.refused:
            forget(work.finals.values(), folder, made=made)
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
    from hoap3.tools.simulate import Lockstep

    check_open_files()
    emulator, description = suited(emulator, controller, files)
    for note in (*follower_notes(description), *jerk_notes(description)):
        to_people(note)
    made, refused = is_new(out), False
    folder = run_folder(emulator.log, out)
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
    except Hoap3Error:
        refused = True
        raise
    finally:
        for observer in observers.values():
            observer.close()
        finals = [observer.final for observer in observers.values()]
        if refused and all(map(nothing_happened, finals)):
            forget(finals, folder, made=made)
    lost = [observer.lost for observer in observers.values() if observer.lost]
    if not all(finals):
        raise Hoap3Error("; ".join(lost))
    summary: dict[str, Any] = observers["robot"].final["summary"]
    summary["log_lost"] = lost
    summary["metrics_lost"] = [o.unserved for o in observers.values() if o.unserved]
    if folder is not None:
        final = observers["controller"].final
    else:
        final = {"certificates": unlogged.count.figures(), "outcome": unlogged.outcome}
    _join(summary, final)
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
    """Both services as children, and what they tell."""

    def __init__(self, news: News, should_stop: Callable[[], bool]) -> None:
        self._news, self._stop = news, should_stop
        self._children: dict[str, Child] = {}
        self._selector = selectors.DefaultSelector()
        self._buffers: dict[int, bytes] = {}
        self._commands: dict[int, str] = {}
        self.said: list[str] = []
        self.summary: dict[str, Any] | None = None
        self.failure: Hoap3Error | None = None
        self.failed = ""  # the one that failed
        self.finals: dict[str, dict[str, Any]] = {}  # last words of both observers
        self.damage: list[str] = []  # why logs are not whole
        self.unserved: list[str] = []  # why metrics are not served

    def start(
        self, command: str, config: str, file: str, folder: Path | None, duration: float | None
    ) -> None:
        """Start a service; its config comes on standard input, named after its file."""
        reader, writer = os.pipe()
        arguments = [command, "-", "--status-fd", str(writer), "--named", file]
        arguments += ["--out", str(folder)] if folder else ["--set", "log.record=false"]
        if duration is not None:
            arguments += ["--duration", str(duration)]
        os.set_blocking(reader, False)
        self._buffers[reader], self._commands[reader] = b"", command
        self._selector.register(reader, selectors.EVENT_READ)
        try:
            self._children[command] = Child(["hoap3.tools.cli.app", *arguments], config, [writer])
        finally:
            os.close(writer)

    def watch(self, duration: float, meanwhile: Callable[[], None]) -> dict[str, Any]:
        """The summary, once the robot has ended its motion, or somebody has ended it."""
        limit = time.monotonic() + START_TIMEOUT_S + 2 * duration
        emulator, controller = self._children["emulator"], self._children["controller"]
        while emulator.poll() is None and controller.poll() is None:
            self._listen(0.1)
            meanwhile()
            if self._stop():
                break
            if time.monotonic() > limit:
                raise Hoap3Error(self._failure("the run did not begin, or did not end, in time"))
        failed = controller.poll() is not None and emulator.poll() is None and not self._stop()
        self.stop()
        if self.failure is not None:
            raise self.failure
        if self._stop() and not (self.summary and self.summary["ticks"]):
            raise Hoap3Error("interrupted before the motion began")
        if failed:
            raise Hoap3Error(self._failure("the controller ended before the robot did"))
        if emulator.returncode < 0:
            number = -emulator.returncode
            raise Hoap3Error(f"the robot was killed by signal {number}: its count is not whole")
        if self.summary is None:
            without = self._failure("the robot ended without a summary")
            raise Hoap3Error("; ".join(self.damage) or without)
        self.summary["log_lost"] = self.damage
        self.summary["metrics_lost"] = self.unserved
        _join(self.summary, self.finals.get("controller", {}))
        return {**self.summary, "interrupted": self._stop(), "duration_s": duration}

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
        while self._buffers and self._listen(0.0):
            pass

    @property
    def refused(self) -> bool:
        """Whether a service failed, or was stopped, before a State had reached the controller."""
        told = self.finals.get("controller", {"states": 0})
        interrupted = self._stop() and not (self.summary or {}).get("ticks")
        return (interrupted or self.failure is not None) and nothing_happened(told)

    def _listen(self, timeout: float) -> bool:
        heard = False
        for key, _ in self._selector.select(timeout):
            try:
                data = os.read(key.fd, 65536)
            except BlockingIOError:
                continue
            heard = True
            if not data:
                self._selector.unregister(key.fd)
                os.close(key.fd)
                del self._buffers[key.fd]
                continue
            *lines, rest = (self._buffers[key.fd] + data).split(b"\n")
            self._buffers[key.fd] = rest
            for line in lines:
                self._hear(json.loads(line), self._commands[key.fd])
        return heard

    def _hear(self, item: dict[str, Any], command: str) -> None:
        if item["news"] in {"said", "damaged", "unserved", "detail", "routine", "not granted"}:
            self.said.append(item["text"])
            if item["news"] == "damaged":
                self.damage.append(item["text"])
            elif item["news"] == "unserved":
                self.unserved.append(item["text"])
        elif item["news"] == "failed" and self.failure is None:
            self.failure = (UsageError if item["usage"] else Hoap3Error)(item["text"])
            self.failed = command
        elif item["news"] == "final":
            self.finals[item["side"]] = item
            self.summary = item.get("summary", self.summary)
        self._news(item)

    def _failure(self, what: str) -> str:
        return f"{what}; last heard: {self.said[-1]}" if self.said else what


def _join(summary: dict[str, Any], controller: dict[str, Any]) -> None:
    """Put what the controller alone knows into the robot's summary.

    Args:
        summary: of the robot; changed.
        controller: last words of the controller's observer; empty where there are none.
    """
    theirs = controller.get("certificates")
    if summary["certificates"] and theirs:
        summary["certificates"]["reasons"] = theirs["reasons"]
    verdict = summary["verdicts"]["deadlines"]
    verdict = FAIL if verdict == NOT_JUDGED else verdict  # answers should have been requested
    deadlines = {"verdict": verdict, **summary["deadlines"]}
    counts = {**summary["limits_and_balance"], **summary}
    summary |= judge(deadlines, counts, controller.get("outcome"), expected=True)


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
