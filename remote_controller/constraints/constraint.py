"""What every constraint gives to a controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Literal

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

GREATEST_SHARE = 0.6  # of ηT in rows of accelerations; (√5 − 1)/2 = 0.618 is what is proved
OUTSIDE = -1e-9  # of a margin: what is below is no rounding

PositionSource = Literal["reference", "measured"]
Level = Literal["velocity", "acceleration"]
"""Of what a controller asks for; one of torques asks for accelerations, and for torque bounds."""
Guarantee = Literal[
    "invariant", "at the tick", "bounded drift", "conditional", "local linearisation"
]
"""What holds in discrete time.

    invariant            from every state that keeps it a next one does; proved
    at the tick          algebraic in what is asked for: kept wherever the rows are
    bounded drift        an equation, from which Euler steps drift no further than is stated
    conditional          while the rows have an answer and the robot can stop in time; else it stops
    local linearisation  at this State, to first order
"""


class Constraint:
    """What joint velocities u, accelerations q̈ or torques may be in a state of the robot.

    For velocities it gives rows of A(q)u ≤ b(q), or of A(q)u = b(q) where `equality`; or bounds,
    which need no rows; or both. For accelerations it gives rows lower ≤ G·q̈ ≤ upper, or bounds. A
    subclass names its settings in a nested `Parameters`, sizes its buffers in `__init__` and
    overrides `update`, `bounds` or both, and for accelerations `update_accelerations` or
    `bound_accelerations`.

    Args:
        parameters: a `Parameters` of this class.
        description: of the robot.
        kinematics: of the robot; may be moved during construction.
        period_s: T, for which u is held [s].

    Attributes:
        levels: for what it gives rows or bounds; elsewhere it is refused when configured.
        guarantee: what holds in discrete time.
        equality: whether the rows are equations.
        yields: whether a row with b < 0 leads back from outside, as fast as the joints' speeds
            allow, rather than asks for a speed that must be had.
        rows: the most rows that it gives.
        names: (rows,) what each row is for.
        margins: of the last update, one for each of `margin_names`; what is negative lies
            outside. inf for what is switched off. Constraints on the velocity alone, and
            equations, have none.
        margin_unit: of the margins; "" where nobody says.
        margin_units: of each margin, where they differ; else empty.
        margin_names: what each margin is of.
        least, greatest: (n,) positions that it keeps [rad or m]; None where it keeps none.
        speed_max, acceleration_max, torque_max: (n,) what it leaves of the joints' speeds,
            accelerations and torques [rad/s, rad/s², N m or m/s, m/s², N]; None where it does not
            speak of them.
        reach: no joint changes a margin faster, no two of them bend it more, but for prismatic
            ones, 1 [m/rad, m/rad²]; 0: the greatest distance of two points of the robot. Of
            `conditional` ones, as is
        sharpness: L²·sharpness, with L the way of a point, is how much more a margin bends [1/m].
        events: how often something happened, by name. All have `outside` (updates with a margin
            below −1e-9) and `started_outside` (first updates after a reset that had one).

    Raises:
        ConfigError: with file "" and the key inside the parameters, which `build` completes.
        FrameNotFoundError: the robot lacks a frame that the parameters name.
    """

    class Parameters(Settings):
        """Settings of this constraint; none here."""

    levels: ClassVar[tuple[Level, ...]] = ("velocity",)
    guarantee: ClassVar[Guarantee] = "local linearisation"
    equality: ClassVar[bool] = False
    yields: ClassVar[bool] = False
    margin_unit: ClassVar[str] = ""

    def __init__(
        self,
        parameters: Settings,
        description: RobotDescription,
        kinematics: Kinematics,
        period_s: float,
    ) -> None:
        self.parameters, self.description, self.period_s = parameters, description, period_s
        self.n = description.n
        self.rows = 0
        self.names: tuple[str, ...] = ()
        self.margins: FloatArray = np.zeros(0)
        self.margin_names: tuple[str, ...] = ()
        self.margin_units: tuple[str, ...] = ()
        self.reach, self.sharpness = 0.0, 0.0
        self.least: FloatArray | None = None
        self.greatest: FloatArray | None = None
        self.speed_max: FloatArray | None = None
        self.acceleration_max: FloatArray | None = None
        self.torque_max: FloatArray | None = None
        self.events = {"outside": 0, "started_outside": 0}
        self._started = False
        self.prepare(parameters, kinematics)

    def prepare(self, parameters: Any, kinematics: Kinematics) -> None:
        """Size the buffers: what a subclass may have instead of an `__init__`.

        Args:
            parameters, kinematics: as `__init__` got them; everything else is set already.
        """

    def apply(self, parameters: Any) -> None:
        """Read the parameters that may change: when it is made, and in a live change.

        Comes between two updates. Numbers of a class without an `apply` of its own cannot change.

        Raises:
            ConfigError: they do not fit; with file "" and the key inside the parameters.
        """

    def reset(self) -> None:
        """Forget what was kept from earlier states; events stay counted."""
        self._started = False

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write the rows for a state; those that are not needed become 0·u ≤ inf, or 0·u = 0.

        Called where there are rows; what has none does its work in `bounds`.

        Args:
            kinematics: up to date.
            state: the newest one.
            A_out: (rows, n), C-contiguous, in wire order.
            b_out: (rows,).
        """

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow lower ≤ u ≤ upper, (n,) [rad/s or m/s]; an interval never becomes empty.

        Where this asks for what the interval excludes, the nearest value in it remains.
        """

    @classmethod
    def serves(cls, level: Level) -> bool:
        """Whether it gives rows or bounds of this kind."""
        return level in cls.levels

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Refuse what cannot be kept by accelerations; called once, before the first of them.

        Args:
            speed: (n,) greatest speeds that constraints and robot leave [rad/s or m/s].
            deceleration: (n,) what joints can brake with [rad/s² or m/s²].

        Raises:
            ConfigError: with file "" and the key inside the parameters.
        """

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write rows lower ≤ G·q̈ ≤ upper for a state; those that are off are −inf ≤ 0·q̈ ≤ inf.

        Called where there are rows.

        Args:
            motion: up to date.
            state: the newest one.
            G_out: (rows, n), C-contiguous, in wire order.
            lower_out, upper_out: (rows,); equal where `equality`.
        """

    def bound_accelerations(
        self, state: State, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Narrow lower ≤ q̈ ≤ upper, (n,) [rad/s² or m/s²], of the measured state, as `bounds`."""

    def margins_at(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write the margins of any posture, without judging it; `conditional` ones can.

        Args:
            kinematics: up to date; the frames' numbers are those of every `Kinematics`.
            out: as `margins`.
        """
        raise NotImplementedError

    def accepts(self, gradient: FloatArray) -> bool:
        """Whether V can decrease under it for this ∇V, (n,); counts an event where it cannot."""
        return True

    def margin(self) -> float:
        """Smallest true margin of the last update; inf where there is none."""
        return float(np.minimum.reduce(self.margins, initial=np.inf))

    def drift(self) -> float:
        """Largest error of the last update that equations shall keep at 0; 0 where none is."""
        return 0.0

    def tightest(self) -> str:
        """What has the smallest margin; "" where there is none."""
        return self.margin_names[int(self.margins.argmin())] if self.margins.size else ""

    def tightest_unit(self) -> str:
        """The unit of the smallest margin; "" where it is not known."""
        units = self.margin_units
        return units[int(self.margins.argmin())] if units else self.margin_unit

    def watch(self, least: float | None = None) -> None:
        """Count where the margins of this update lie outside; `update` or `bounds` calls it.

        Args:
            least: the smallest margin, where it is known already.
        """
        if (self.margin() if least is None else least) < OUTSIDE:
            self.events["outside"] += 1
            self.events["started_outside"] += not self._started
        self._started = True

    def rate_of(
        self, parameters: Any, brakes: tuple[FloatArray, FloatArray] | None = None
    ) -> float:
        """η of (25), which must not overstep the limit within one period: ηT ≤ 1.

        For rows of accelerations ηT ≤ 0.6, and η·v ≤ a for each joint: where all joints brake with
        η times their speed, q̈ = −η·q̇, m̈ = −ηṁ but for the curvature, which is what the row asks
        for at ṁ = −ηm.

        Args:
            parameters: with `eta_per_s`; one that is not set is lowered to what brakes allow.
            brakes: speed and deceleration as of `prepare_accelerations`; None for velocities.

        Raises:
            ConfigError: an η that is set and asks for more.
        """
        wanted: float = parameters.eta_per_s
        share, period_s = wanted * self.period_s, self.period_s
        if share > 1.0:
            problem = f"η·T = {share:.6g} oversteps the limit within one period of {period_s:g} s"
            remedy = f"At most 1/T = {1.0 / period_s:.17g}"
            if "acceleration" in self.levels:
                remedy += f"; for accelerations {GREATEST_SHARE}/T, or what joints can brake with"
            raise ConfigError("", "eta_per_s", wanted, problem, remedy)
        if brakes is None:
            return wanted
        speed, deceleration = brakes
        braking = np.divide(
            deceleration, speed, out=np.full(self.n, np.inf), where=(speed > 0.0) & (speed < np.inf)
        )
        braking[speed == np.inf] = 0.0
        joint = int(braking.argmin())
        most = min(GREATEST_SHARE / period_s, float(braking[joint]))
        if wanted <= most or ("eta_per_s" not in parameters.model_fields_set and most > 0.0):
            return min(wanted, most)
        if most < braking[joint]:
            problem = f"η·T is above {GREATEST_SHARE} in rows of accelerations"
            remedy = f"At most {GREATEST_SHARE}/T = {most}"
        else:
            problem = (
                f"joint {self.description.joint_names[joint]!r} may move with {speed[joint]:.6g} "
                f"and brakes with {deceleration[joint]:.6g}: too little for η times its speed"
            )
            remedy = f"At most {most}, or limit speeds by joint_velocity"
        raise ConfigError("", "eta_per_s", wanted, problem, remedy)

    def joint_indices(self, key: str, names: Iterable[str]) -> list[int]:
        """Places of joints in the wire order.

        Raises:
            ConfigError: the robot has no joint of such a name.
        """
        known = self.description.joint_names
        for name in names:
            if name not in known:
                problem = f"robot {self.description.name!r} has no such joint"
                raise ConfigError("", key, name, problem, one_of(name, known, "Joints"))
        return [known.index(name) for name in names]


def positions(state: State, source: PositionSource) -> FloatArray:
    """Joint positions of a state, (n,): what the robot applies, or what it measures."""
    return state.reference if source == "reference" else state.q
