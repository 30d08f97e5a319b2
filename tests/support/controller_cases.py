"""Which controllers the property suite runs over, and a robot for each to move.

`CASES` are the shipped configs, or whatever `HOAP3_TEST_CONTROLLERS` names: config files,
`package.module:Class`, or registered names, separated by commas. The robot of a case is the one
that its config names, as the shipped emulator config of that robot has it, if there is one
that takes its commands;
`HOAP3_TEST_ROBOT` names another for all, or the path of its description. `POSITIONS` are the cases
whose robot takes these.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.config import ControllerConfig, available_configs, build, read_config
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.config import available_configs as emulator_configs
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.service import describe
from hoap3.tools.simulate import emulator_content, suited
from support.small_arm import arm

_named = os.environ.get("HOAP3_TEST_CONTROLLERS", "")
CASES = [name.strip() for name in _named.split(",") if name.strip()] or available_configs()
ROBOT = os.environ.get("HOAP3_TEST_ROBOT", "")


@cache
def emulator(case: str = "") -> EmulatorConfig:
    """Settings of the robot of a case; without one HOAP-3."""
    if ROBOT:
        return parse(EmulatorConfig, *emulator_content(ROBOT))
    wanted = config(case).robot if case else "hoap3"
    shipped = [parse(EmulatorConfig, *emulator_content(name)) for name in emulator_configs()]
    gives = find(config(case).controller).commands if case else ("position",)
    free = stands_free(case)
    takes = gives if free else (None, *gives)
    fitting = [
        known
        for known in shipped
        if known.robot == wanted and known.command in takes and falls(known) == free
    ]
    found = fitting[0] if fitting else parse(EmulatorConfig, *emulator_content(wanted))
    return suited(found, config(case), ("test", case))[0] if case else found


def stands_free(case: str) -> bool:
    """Whether a case balances a robot whose base is free."""
    return bool(case) and config(case).parameters.get("base") == "free"


def falls(known: EmulatorConfig) -> bool:
    """Whether the base of a robot is free."""
    return known.plant.parameters.get("base") == "free"


@cache
def robot(case: str = "") -> RobotDescription:
    return describe(emulator(case))


@cache
def config(case: str) -> ControllerConfig:
    content, file = read_config(case)
    return parse(ControllerConfig, content, file)


def make(case: str, description: RobotDescription | None = None) -> Controller:
    """A new controller, whose clock stands still."""
    controller: Controller = build(config(case), description or robot(case), case)
    controller.now = lambda: 0
    return controller


class Body:
    """A robot without loops, links and clocks: its setpoint_filter, its body, and its State."""

    def __init__(self, description: RobotDescription, **plant: object) -> None:
        self._dt = description.period_s
        self._plant, self._setpoint_filter = build_body(description, EmulatorConfig(plant=plant))
        self._plant.reset(description.initial_position)
        self._setpoint_filter.reset(description.initial_position)
        self.state = state_for(description)
        self.state.mode = State.ACTIVE
        self._measure()

    def follow(self, setpoint: FloatArray) -> None:
        """Advance by one period."""
        self._setpoint_filter.follow(setpoint, self.state.tick)
        self._plant.step(self._setpoint_filter.value, self._dt)
        self.state.tick += 1
        self._measure()

    def _measure(self) -> None:
        self.state.q[:], self.state.dq[:] = self._plant.q, self._plant.dq
        self.state.reference[:] = self._setpoint_filter.reference
        self.state.base[:], self.state.contact[:] = self._plant.base, self._plant.contact


def moved(controller: Controller, body: Body, ticks: int) -> Iterator[tuple[bytes, FloatArray]]:
    """Each State of a motion as the controller was given it, and the setpoint that answers it."""
    for _ in range(ticks):
        payload = body.state.dump()
        values = controller.step(body.state).values.copy()
        yield payload, values
        body.follow(values)


def state_for(description: RobotDescription) -> State:
    """A State with what controllers look at."""
    arrays = description.state_arrays
    more = {name: arrays[name] for name in ("base", "contact") if name in arrays}
    return State(description.n, 6 * len(description.wrench_sensors), **more)


def state_of(description: RobotDescription, payload: bytes) -> State:
    state = state_for(description)
    state.load(payload)
    return state


def body_of(case: str, description: RobotDescription | None = None) -> Body:
    """The robot of a case, or one like it, at rest."""
    plant = emulator(case).plant.model_dump() if falls(emulator(case)) else {}
    return Body(description or robot(case), **plant)


@cache
def motion(case: str, ticks: int = 1200) -> tuple[tuple[bytes, ...], FloatArray]:
    """States of a motion of the robot, as payloads, and the setpoints, (ticks, n)."""
    body, controller = body_of(case), make(case)
    controller.reset(body.state, None)
    payloads, setpoints = zip(*moved(controller, body, ticks), strict=True)
    return payloads, np.array(setpoints)


POSITIONS = [case for case in CASES if robot(case).command_kinds[0] == "position"]


def one_joint_arm() -> RobotDescription:
    """The shoulder of the small arm alone: two links of 1 kg."""
    urdf = arm().urdf
    cut = urdf.index('<joint name="elbow"')
    for link in ("fore", "hand"):
        start = urdf.index(f'<link name="{link}"')
        end = urdf.index("</link>", start) + len("</link>")
        urdf, cut = urdf[:start] + urdf[end:], cut - (end - start)
    return arm(urdf=urdf[:cut] + "</robot>", joints=arm().joints[:1], postures={"start": (0.1,)})
