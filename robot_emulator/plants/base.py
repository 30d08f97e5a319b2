"""What every body does, and what it says about itself before it is built."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.robot_emulator.config import PlantSettings

TOLD = ("base", "contact", "imu")
"""Arrays of State that a plant may fill beside those that every robot has."""


@dataclass(frozen=True)
class Declared:
    """What a plant says of itself before it is built.

    Attributes:
        base, contact, imu: lengths of these arrays of State.
        servo_rate_1_s: as the description has it [1/s]; None for servos that do not give way.
        armature: rotors of the joints, (n,) [kg m² or kg], where they are not the description's:
            what turns accelerations into torques must know of them.
    """

    base: int = 0
    contact: int = 0
    imu: int = 0
    servo_rate_1_s: float | None = None
    armature: tuple[float, ...] | None = None


class TorqueModel(Protocol):
    """What the filter before torques asks: which accelerations they give, and the reverse."""

    def accelerations(self, command: FloatArray, dt: float, out: FloatArray) -> int:
        """Write what torques, (n,), would give over `dt` [s], (n,) [rad/s² or m/s²].

        Returns:
            The number of the first joint whose torque is beyond its effort, or -1.
        """

    def torques(self, ddq: FloatArray, dt: float, out: FloatArray) -> int:
        """Write the command, (n,), that accelerations need over `dt` [s], as far as efforts allow.

        Returns:
            The number of the first joint whose effort is too small, or -1.
        """

    def share(self, ddq: FloatArray, dt: float) -> float:
        """How much of accelerations, (n,), the efforts suffice for over `dt` [s], all joints alike.

        Returns:
            The largest share, 0 to 1; -1 where they do not even suffice for no acceleration.
        """


class Plant(ABC):
    """A body that advances by one period at a time.

    A subclass fills the arrays in place, and keeps them: the loop and the filter before the plant
    hold on to them. `docs/guides/plants.md` has a whole one.

    Args:
        description: of the robot; the first of its `command_kinds` is what `step` is given.
        parameters: an instance of the nested `Parameters`.

    Attributes:
        q: measured positions, (n,), rad or m.
        dq: measured velocities, (n,), rad/s or m/s.
        tau: measured efforts, (n,), N m or N.
        wrench: fx fy fz tx ty tz of each of the description's wrench sensors, N and N m.
        base, contact, imu: as in docs/reference/wire.md, with the lengths that `declare` gives.
        start: the reference that holds it where `reset` put it, (n,): q, or beyond it by what a
            servo gives way.
        saturated: periods in which a motor was asked for more than its effort, and gave that.
        torque_model: what torques do, for the filter before them; None: the description's rigid
            body without contacts.
    """

    class Parameters(Settings):
        """`plant.parameters`: none."""

    commands: ClassVar[tuple[CommandKind, ...]] = ()
    """Kinds of setpoints that it can take."""

    heeds: ClassVar[tuple[str, ...]] = ()
    """Keys of `plant` that it reads, beside `kind` and `parameters`."""

    kernels: ClassVar[tuple[str, ...]] = ()
    """Modules that a service compiles before anything else."""

    torque_model: TorqueModel | None = None
    saturated: int = 0

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        del parameters
        lengths = description.state_arrays
        self.q, self.dq, self.tau, self.start = np.zeros((4, description.n))
        self.wrench = np.zeros(6 * len(description.wrench_sensors))
        self.base, self.contact, self.imu = (np.zeros(lengths.get(name, 0)) for name in TOLD)

    @classmethod
    def configured(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Settings, seed: int
    ) -> Self:
        """Make one; override it where it needs the other keys of `plant`, or the seed."""
        del settings, seed
        return cls(description, parameters)

    @classmethod
    def declare(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any
    ) -> Declared:
        """Say what it measures, and refuse settings that do not fit the robot.

        Raises:
            ConfigError: with file "" and a key below `plant`.
        """
        del description, settings, parameters
        return Declared()

    @abstractmethod
    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""

    @abstractmethod
    def step(self, command: FloatArray, dt: float) -> None:
        """Advance by `dt` [s] under `command`, (n,)."""

    @abstractmethod
    def hold(self, dt: float) -> None:
        """Advance by `dt` [s] at rest, or coming to rest: nobody commands."""

    def notes(self) -> list[str]:
        """What people should know of it at the start, a line each."""
        return []

    def summary(self) -> dict[str, Any]:
        """Figures of the run, for the log and for `--json`; the same in every run in lockstep."""
        return {}
