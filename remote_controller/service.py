"""The remote controller as a service: waits for its robot, answers it, survives its absence."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Sequence
from typing import Any

from protocol.clock import Clock, MonotonicClock, VirtualClock
from protocol.compilation import warm_up
from protocol.description import RobotDescription
from protocol.errors import AuthorityError, UsageError
from protocol.link import Request
from protocol.messages import State
from protocol.realtime import prepare_process
from protocol.recorder import Recorder
from protocol.zenoh_link import ZenohControllerLink
from remote_controller.config import ControllerConfig, build
from remote_controller.controllers.controller import Controller
from remote_controller.loop import ControllerLoop, failure
from remote_controller.registry import find

KERNELS = (
    "remote_controller.solvers.qp12_kernels",
    "remote_controller.solvers.pinv_kernels",
    "remote_controller.kinematics_kernels",
    "remote_controller.controllers.descent_kernels",
)
REHEARSALS = 200
RETRY_S = 0.2


def prepare(report: Callable[[str], None], own: Sequence[str] = ()) -> None:
    """Import and compile whatever is slow to, before anything is real time.

    Args:
        report: takes what is done.
        own: modules that the controller needs besides.
    """
    import pinocchio  # noqa: F401, PLC0415 - half a second, better now than in the loop

    warm_up((*KERNELS, *own), lambda name: report(f"kernels: {name}"))


def rehearse(controller: Controller, description: RobotDescription) -> None:
    """Step through the start posture until nothing happens for the first time.

    Raises:
        Hoap3Error: the controller failed.
    """
    state = State(description.n, 6 * len(description.wrench_sensors))
    state.q[:] = state.reference[:] = description.initial_position
    try:
        controller.reset(state, None)
        for tick in range(REHEARSALS):
            state.tick = tick
            controller.step(state)
    except (Exception, SystemExit) as error:  # nobody else may end us
        what = f"failed when it rehearsed with robot {description.name!r}, {description.n} joints"
        raise failure(controller, what, error) from error


def serve(request: Request, loop: ControllerLoop) -> None:
    """Do what somebody asks of the controller, between two samples, and answer.

    Raises:
        Hoap3Error: the controller failed.
    """
    try:
        if request.verb == "change":
            loop.change(request.body)
        request.answer({"error": None, "now": loop.changeable()})
    except UsageError as error:
        request.answer({"error": str(error), "now": None})


class Service:
    """Runs one configured controller against one robot over Zenoh.

    Args:
        config, file: of the controller, and where it was read.
        recorder: where the log goes.
        report: takes what people should know.
        should_stop: asked at each sample.
        patient: where the log goes in lockstep, and nothing of it may be lost.
        on_stop: takes what is to be called when an end is asked for while no sample comes.
    """

    def __init__(
        self,
        config: ControllerConfig,
        recorder: Recorder,
        report: Callable[[str], None],
        should_stop: Callable[[], bool],
        file: str = "config",
        patient: Recorder | None = None,
        on_stop: Callable[[Callable[[], None]], None] | None = None,
    ) -> None:
        self._config, self._file = config, file
        self._recorder, self._report, self._should_stop = recorder, report, should_stop
        self._patient = patient or recorder
        self._on_stop = on_stop
        self._digest = ""
        self._departures = 0
        self._controller: Controller | None = None
        self._clock: Clock = MonotonicClock()
        self.loop: ControllerLoop | None = None

    def run(self) -> None:
        """Answer the robot until told to stop; authority is given back at an orderly end.

        Where the controller fails, it is not: the robot finds its holder gone, and stops safely.

        Raises:
            AuthorityError: the robot follows another controller.
            ConfigError: the controller does not fit the robot.
        """
        prepare(self._report, find(self._config.controller, self._file).kernels)
        for measure in prepare_process(self._config.realtime):
            self._report(str(measure))
        name = self._config.controller.replace(":", ".").rsplit(".", 1)[-1].lower()
        who = f"{name[:24]}-{os.getpid()}-{socket.gethostname()[:24]}".replace("/", "-")
        link = ZenohControllerLink(self._config.robot, self._config.link, who)
        if self._on_stop is not None:
            self._on_stop(link.wake)
        try:
            while not self._should_stop():
                if self._join(link):
                    self._follow(link)
            link.ask("release")
        finally:
            link.close()

    def _join(self, link: ZenohControllerLink) -> bool:
        """Wait for the robot, build the controller that it needs, ask for authority."""
        self._departures = link.departures
        endpoints = ", ".join(self._config.link.connect)
        said = False
        while not self._should_stop():
            data = link.ask("description")
            status = link.ask("status") if data is not None else None
            if data is not None and status is not None:
                return self._engage(link, data, json.loads(status))
            if not said:
                self._report(f"waiting for robot {link.robot!r} at {endpoints}")
                said = True
            link.presence.wait(RETRY_S)
        return False

    def _engage(self, link: ZenohControllerLink, data: bytes, status: dict[str, Any]) -> bool:
        description = RobotDescription.from_json(data)
        if self._controller is None or description.digest != self._digest:
            self._controller = build(self._config, description, self._file)
            self._digest = description.digest
        self._clock = VirtualClock() if status["lockstep"] else MonotonicClock()
        rehearse(self._controller, description)
        recorder = self._patient if status["lockstep"] else self._recorder
        self.loop = ControllerLoop(self._controller, self._clock, recorder, status["session_id"])
        self.loop.begin(description, lockstep=status["lockstep"])
        reply = link.ask("acquire")
        if reply is None:
            return False
        grant = json.loads(reply)
        if not grant["granted"]:
            raise AuthorityError(link.robot, str(grant["holder"]))
        self.loop.grant(grant["epoch"])
        self.loop.announce("ROBOT_FOUND", grant["epoch"])
        self._report(f"following robot {link.robot!r} from tick {grant['from_tick']}")
        return True

    def _follow(self, link: ZenohControllerLink) -> None:
        """Answer samples until the robot goes, starts anew, or we are told to stop."""
        loop = self.loop
        if loop is None:
            return
        wait, publish, asked = link.wait, link.publish, link.request
        answer, sent = loop.answer, loop.sent
        while not self._should_stop():
            arrival = wait()
            if link.departures != self._departures:
                break
            if arrival is None:
                continue
            setpoint = answer(*arrival)
            if setpoint is not None:
                publish(setpoint)
            sent()
            request = asked()
            if request is not None:
                serve(request, loop)
            if loop.stale:
                break
        else:
            return
        loop.announce("ROBOT_LOST", loop.last_tick)
        gone = "no longer follows us" if loop.stale else "is gone"
        self._report(f"robot {link.robot!r} {gone}")
