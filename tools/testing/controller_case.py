"""A controller that the property suite runs over, the robot that it moves, and its motions."""

from __future__ import annotations

from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build, read_config
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.config import EmulatorConfig, available_configs
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import load_emulator_config, resolve_configs
from hoap3.tools.services.simulate import Simulation, simulate
from hoap3.tools.testing.body import Body, moved


class ControllerCase:
    """One controller with its settings.

    Args:
        name: a config file, `package.module:Class`, or a registered name.
        robot: its name, or the path of its description. By default the one that the config names,
            as the shipped emulator config of that robot has it, if there is one that takes its
            commands.
    """

    def __init__(self, name: str, robot: str | None = None) -> None:
        self.name, self._robot = name, robot

    @property
    def label(self) -> str:
        """What its tests are called by."""
        return Path(self.name).name if self.name.endswith((".yaml", ".yml")) else self.name

    @cached_property
    def config(self) -> ControllerConfig:
        """Its settings."""
        return parse(ControllerConfig, *read_config(self.name))

    @cached_property
    def emulator(self) -> EmulatorConfig:
        """Settings of its robot."""
        if self._robot:
            wanted = load_emulator_config(self._robot)[0]
            return resolve_configs(wanted, self.config, ("test", self.name))[0]
        gives = find(self.config.controller).commands
        takes = gives if self.stands_free else (None, *gives)
        shipped = [load_emulator_config(name)[0] for name in available_configs()]
        fitting = [
            known
            for known in shipped
            if known.robot == self.config.robot
            and known.command in takes
            and (known.plant.parameters.get("base") == "free") == self.stands_free
        ]
        found = fitting or [load_emulator_config(self.config.robot)[0]]
        return resolve_configs(found[0], self.config, ("test", self.name))[0]

    @cached_property
    def robot(self) -> RobotDescription:
        """Description of its robot."""
        return describe(self.emulator)

    @property
    def stands_free(self) -> bool:
        """Whether it balances a robot whose base is free."""
        return self.config.parameters.get("base") == "free"

    @property
    def gives_positions(self) -> bool:
        """Whether its setpoints are positions."""
        return self.robot.command_kinds[0] == "position"

    def body(self, description: RobotDescription | None = None) -> Body:
        """Its robot, or one like it, at rest."""
        plant = self.emulator.plant.model_dump() if self.stands_free else {}
        return Body(description or self.robot, **plant)

    def make(self, description: RobotDescription | None = None) -> Controller:
        """A new controller, whose clock stands still."""
        controller: Controller = build(self.config, description or self.robot, self.name)
        controller.now = lambda: 0
        return controller

    def run(self, duration: float, **changes: Any) -> Simulation:
        """A run in lockstep, with changed settings of the robot."""
        return simulate(self.emulator.model_copy(update=changes), self.config, duration)

    @cached_property
    def motion(self) -> tuple[tuple[bytes, ...], FloatArray]:
        """States of a motion of the robot, as payloads, and the setpoints, (ticks, n)."""
        body, controller = self.body(), self.make()
        controller.reset(body.state, None)
        payloads, setpoints = zip(*moved(controller, body, LENGTH), strict=True)
        return payloads, np.array(setpoints)

    def two_seconds(
        self, posture: str | tuple[float, ...] | None
    ) -> tuple[np.ndarray[Any, Any], FloatArray]:
        """The setpoints of a motion, and the references that the robot applied."""
        return _two_seconds(self, posture)


LENGTH = 1200  # ticks of the motion that is looked at


@cache
def controller_case(name: str, robot: str | None) -> ControllerCase:
    """The one case of that name and robot."""
    return ControllerCase(name, robot)


@cache
def _two_seconds(
    case: ControllerCase, posture: str | tuple[float, ...] | None
) -> tuple[np.ndarray[Any, Any], FloatArray]:
    done = case.run(2.0, posture=posture)
    return done.setpoints, done.states["reference"]
