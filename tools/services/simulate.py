"""A robot and its controller in one process, in lockstep, without files: for experiments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.errors import ConfigError, Hoap3Error
from hoap3.protocol.link.base import DelayModel, LockstepLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.deadlines import Deadlines
from hoap3.protocol.runtime.recorder import MemoryRecorder, Recorder
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.robot_emulator.service import build_loop
from hoap3.tools.logs.motion_files import as_written
from hoap3.tools.services.configs import (
    load_controller_config,
    load_emulator_config,
    resolve_configs,
)

REPORTED_TICKS = 100  # after so many ticks the progress is told


class Lockstep:
    """Robot and controller joined by a link on virtual time.

    Args:
        emulator, controller: settings of both sides.
        robot_recorder, controller_recorder: where their logs go.
        fate: what becomes of each answer; by default it arrives after the configured time.
        steer: is given the controller's loop after each answer, and may steer it.
        files: names of both configs, for errors.

    Attributes:
        robot, controller_loop: both loops.
        controller: the answers' author.
    """

    def __init__(
        self,
        emulator: EmulatorConfig,
        controller: ControllerConfig,
        robot_recorder: Recorder,
        controller_recorder: Recorder,
        fate: DelayModel | None = None,
        files: tuple[str, str] = ("config", "config"),
        steer: Callable[[ControllerLoop], None] | None = None,
    ) -> None:
        emulator, description = resolve_configs(emulator, controller, files)
        self.clock = clock = VirtualClock()
        compute_time = round(emulator.lockstep.compute_time_us * 1e3)
        self.link = LockstepLink(self._exchange, clock, compute_time, fate)
        self.controller: Controller = build(controller, description, files[1])
        self.robot: RobotLoop = build_loop(
            emulator, description, clock, self.link, robot_recorder, lockstep=True
        )
        self.controller_loop = ControllerLoop(
            self.controller, clock, controller_recorder, emulator.seed
        )
        self.controller_loop.begin(description, lockstep=True)
        self.controller_loop.note_config(emulator.model_dump_json().encode())
        self._failure: Hoap3Error | None = None
        self._steer = steer
        said = as_written(controller).model_dump_json().encode()
        self._grants = self.link.ask("acquire", "lockstep", said)

    def run(
        self,
        duration: float,
        should_stop: Callable[[], bool] = lambda: False,
        report: Callable[[int, int], None] | None = None,
    ) -> None:
        """Run for `duration` [s] of virtual time, then bring the robot to rest.

        Args:
            duration: of the motion [s].
            should_stop: asked at each tick.
            report: takes how many ticks are done, of how many.

        Raises:
            Hoap3Error: the controller failed; the robot has come to rest.
        """
        ticks = round(duration * 1e9 / self.robot.period)

        def ended() -> bool:
            if report is not None and self.robot.tick % REPORTED_TICKS == 0:
                report(min(self.robot.tick, ticks), ticks)
            stopped = self._failure is not None and self.robot.mode != State.ACTIVE
            return stopped or should_stop()

        self.robot.run(0, ended, ticks)
        if self._failure is not None:
            raise self._failure

    def _exchange(self, state: bytes) -> bytes | None:
        loop = self.controller_loop
        if self._failure is not None:
            return None
        if self._grants:
            grant = self._grants.pop()
            if isinstance(grant, dict):
                loop.grant(grant["epoch"])
        try:
            answer = loop.answer(self.clock.now(), state)
        except Hoap3Error as error:
            self._failure = error
            self.link.ask("gone", "lockstep")  # as if its process had ended
            return None
        loop.sent()
        if self._steer is not None:
            self._steer(loop)
        return answer


@dataclass(frozen=True)
class Simulation:
    """What happened, as arrays with one row per tick.

    Attributes:
        states, setpoints: structured arrays; fields as in the `.msg` files.
        log: the controller's.
        deadlines: outcomes of the ticks that asked for an answer.
        controller: in its final state.
    """

    states: np.ndarray[Any, Any]
    setpoints: np.ndarray[Any, Any]
    log: MemoryRecorder
    deadlines: Deadlines
    controller: Controller

    def __repr__(self) -> str:
        counts = f"{len(self.states)} states, {len(self.setpoints)} setpoints"
        return f"Simulation({counts}, {self.deadlines.run_rate:.5f} in time)"

    @property
    def records(self) -> list[Record]:
        """The controller's log, for `hoap3.tools.analysis.replay`."""
        return self.log.records

    @property
    def time(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Time of each State [s]."""
        return np.asarray(self.states["stamp_intended"] * 1e-9)


def simulate(
    robot: str | Path | Mapping[str, Any] | EmulatorConfig = "hoap3",
    controller: str | Path | Mapping[str, Any] | ControllerConfig = DEFAULT_CONFIG,
    duration: float = 5.0,
    seed: int = 0,
    fate: DelayModel | None = None,
    report: Callable[[int, int], None] | None = None,
    steer: Callable[[ControllerLoop], None] | None = None,
) -> Simulation:
    """Run a robot and a controller against each other, faster than real time.

    Args:
        robot: name or file of an emulator config, a robot's name or path, settings, or a mapping.
        controller: name or file of a controller config, settings, or a mapping.
        duration: of the motion [s]; the robot then comes to rest.
        seed: names the session, and everything random.
        fate: what becomes of each answer on its way, see `hoap3.protocol.link.base.LockstepLink`.
        report: takes how many ticks are done, of how many.
        steer: is given the controller's loop after each answer, and may steer its live targets.

    Raises:
        UsageError: something in the settings is wrong.
    """
    if not duration > 0.0:
        raise ConfigError("simulate", "duration", duration, "is not positive", "Give seconds")
    emulator, file = load_emulator_config(robot, seed=seed)
    log, robot_log = MemoryRecorder(), MemoryRecorder()
    settings, controller_file = load_controller_config(controller)
    files = file, controller_file
    lockstep = Lockstep(emulator, settings, robot_log, log, fate, files, steer)
    lockstep.run(duration, report=report)
    return Simulation(
        states=table_of(robot_log.payloads(Kind.STATE), State),
        setpoints=table_of(log.payloads(Kind.SETPOINT), Setpoint),
        log=log,
        deadlines=lockstep.robot.validator.deadlines,
        controller=lockstep.controller,
    )


def table_of(payloads: list[bytes], message: type[State] | type[Setpoint]) -> np.ndarray[Any, Any]:
    """Messages of one layout as a structured array."""
    schema = message.schema
    if not payloads:
        return np.zeros(0, schema.dtype({}))
    dtype = schema.dtype(schema.lengths_in(payloads[0]))
    return np.frombuffer(b"".join(payloads), dtype)
