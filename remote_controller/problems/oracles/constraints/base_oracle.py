"""What every constraint says of a cycle: bounds on the joints, rows, and how far inside it is.

At each level it has its own: for velocities u of all cycles, for accelerations q̈ of one State.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.statement import Claim

Array = NDArray[np.float64]
States = Any  # of all cycles: an array of `State` rows, or what indexes like one

Level = Literal["velocity", "acceleration"]
ROUNDING = 64.0 * float(np.finfo(float).eps)  # m or rad: how exactly a place is known
GREATEST_SHARE = 0.6  # of ηT in rows of accelerations


@dataclass(frozen=True)
class Rows:
    """A u ≤ b of one cycle, or A u = b.

    Attributes:
        A: (s, n).
        b: (s,); inf where a row is off.
        asked: (s,) whether the controller is known to have kept the row. Of some constraints
            others are possible: they may hold u, and need not.
    """

    A: Array
    b: Array
    asked: NDArray[np.bool_]


@dataclass
class Bounds:
    """Of the joints' velocities, cycle by cycle.

    Attributes:
        lower, upper: (N, n) [rad/s or m/s].
    """

    lower: Array
    upper: Array

    def narrow(self, lower: Array, upper: Array) -> None:
        """Keep what is in both; where nothing is, what of these is nearest to the others."""
        low = np.clip(lower, self.lower, self.upper)
        self.upper = np.clip(upper, self.lower, self.upper)
        self.lower = low


@dataclass
class Constraint:
    """One constraint of a config; a subclass knows what it means.

    Args:
        settings: of the constraint, complete.
        description: of the robot.
        robot: its kinematics.

    Attributes:
        margins: of the cycles, (N,), inf where it has none; for accelerations all of one State.
        amplifies: what a margin makes of an error in a place, in its unit per m or rad.
        speed_max, acceleration_max, torque_max: (n,) what it leaves of the joints' limits.
    """

    defaults: ClassVar[Mapping[str, Any]] = {}
    equality: ClassVar[bool] = False
    yields: ClassVar[bool] = False
    has_rows: ClassVar[bool] = False
    has_memory: ClassVar[bool] = False
    """Whether its rows depend on cycles before."""
    limits_speed: ClassVar[bool] = False
    limits_accelerations: ClassVar[bool] = False
    is_conditional = False
    """Whether the robot must be able to stop before its margins are negative."""

    settings: Mapping[str, Any]
    description: RobotDescription
    robot: Robot
    margins: Array = field(default_factory=lambda: np.zeros(0))
    amplifies: float = 1.0
    speed_max: Array | float = np.inf
    acceleration_max: Array | float = np.inf
    torque_max: Array | float = np.inf

    def __post_init__(self) -> None:
        self.prepare()

    def prepare(self) -> None:
        """Read the settings.

        Raises:
            UnverifiableError, FrameNotFoundError: they cannot be reckoned with.
        """

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow the bounds of all cycles, and write `margins`.

        Args:
            states: of the cycles, (N,).
            cycles: which they are.
            bounds: changed.
        """
        self.margins = np.full(len(states), np.inf)

    def begin(self, state: Any) -> None:
        """Forget everything; `robot` is placed where it is at this State."""

    def take_over(self, other: Constraint) -> None:
        """Keep what a constraint remembers whose parameters are changed, after `begin`."""

    def rows(self, state: Any, number: int) -> Rows:
        """Rows of a cycle; `robot` is placed.

        Args:
            state: of the cycle.
            number: of the cycle; its margin is written.
        """
        raise NotImplementedError

    @property
    def margin(self) -> float:
        """The least one, for accelerations."""
        return float(self.margins.min(initial=np.inf))

    def fit(self, speed: Array, brake: Array) -> None:
        """Prepare for accelerations.

        Args:
            speed: (n,) greatest speeds that constraints and robot leave [rad/s or m/s].
            brake: (n,) what joints can brake with [rad/s² or m/s²].
        """

    def follow(self, state: Any) -> None:
        """Remember a State, at which `robot` is placed and moved; for `has_memory`."""

    def interval(self, q: Array, dq: Array) -> tuple[Array, Array] | None:
        """Bounds of q̈, (n,) each, of the measured State; None where it has none."""
        del q, dq
        return None

    def acceleration_rows(self, dq: Array) -> statement.Rows | None:
        """Rows of q̈ where `robot` is placed and moved, (s, n); `margins` are written."""
        del dq
        return None

    def margins_here(self) -> Array:
        """Margins where `robot` is placed, as `margins`, of a conditional one."""
        return self.margins

    def derivative_claims(self) -> list[Claim]:
        """Claims that the derivatives are those of the margins, where rows were computed last."""
        return []

    def accepts(self, gradient: Array) -> bool:
        """Whether the rows of the last cycle count for this ∇V, (n,)."""
        return True

    def positions(self, states: States) -> Array:
        """Joint positions that the settings name, (N, n) or (n,)."""
        measured = self.settings["positions_from"] == "measured"
        return np.asarray(states["q" if measured else "reference"])

    def joints(self, names: object) -> list[int]:
        """Places of named joints.

        Raises:
            UnverifiableError: the robot has no such joint.
        """
        known = list(self.description.joint_names)
        if not isinstance(names, list | tuple) or any(name not in known for name in names):
            raise UnverifiableError(f"a constraint names joints {names!r:.60}")
        return [known.index(name) for name in names]


def fitted_rate(eta: float, period_s: float, speed: Array, brake: Array) -> float:
    """Return η of rows of accelerations, with which no joint brakes harder than it can."""
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.where(speed == np.inf, 0.0, np.where(speed > 0.0, brake / speed, np.inf))
    return min(eta, GREATEST_SHARE / period_s, float(most.min()))


def sides(
    A: Array,
    lower: Array | float,
    upper: Array,
    dq: Array,
    eta: float = 0.0,
    error: Array | float = 0.0,
    optional: NDArray[np.bool_] | bool = False,
) -> statement.Rows:
    """Return rows of q̈ with the rounding of 2ηṁ + η²m − Ȧq̇, added to `error`."""
    size = 1.0 + np.abs(A).sum(1)
    rounding = ROUNDING * size * (1.0 + eta + float(np.abs(dq).sum())) ** 2
    found = {"error": rounding + error, "A_error": ROUNDING * size, "optional": optional}
    return statement.Rows.of(A, lower, upper, **found)
