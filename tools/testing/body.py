"""A robot without loops, links and clocks, for tests that need it to move."""

from __future__ import annotations

from collections.abc import Iterator

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import Controller
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.plant_factory import build_body


class Body:
    """Its setpoint filter, its plant, and its State.

    Args:
        description: of the robot.
        plant: settings of `plant` in an emulator config.

    Attributes:
        state: what it measures; overwritten by each `follow`.
    """

    def __init__(self, description: RobotDescription, **plant: object) -> None:
        self._dt = description.period_s
        settings = EmulatorConfig.model_validate({"plant": plant})
        self._plant, self._setpoint_filter = build_body(description, settings)
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
    """A State of such a robot, with what controllers look at."""
    arrays = description.state_arrays
    more = {name: arrays[name] for name in ("base", "contact") if name in arrays}
    return State(description.n, 6 * len(description.wrench_sensors), **more)


def state_of(description: RobotDescription, payload: bytes) -> State:
    """A State of such a robot, of its bytes."""
    state = state_for(description)
    state.load(payload)
    return state
