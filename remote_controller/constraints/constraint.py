"""What every constraint gives to a controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Literal

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.model.kinematics import Kinematics

OUTSIDE = -1e-9  # of a margin: what is below is no rounding

PositionSource = Literal["reference", "measured"]


class Constraint:
    """What the joint velocities u may be in a state of the robot.

    It gives rows of A(q)u ≤ b(q), or of A(q)u = b(q) where `equality`; or bounds, which need no
    rows; or both. A subclass names its settings in a nested `Parameters`, sizes its buffers in
    `__init__` and overrides `update`, `bounds` or both.

    Args:
        parameters: a `Parameters` of this class.
        description: of the robot.
        kinematics: of the robot; may be moved during construction.
        period_s: T, for which u is held [s].

    Attributes:
        equality: whether the rows are equations.
        yields: whether a row with b < 0 leads back from outside, as fast as the joints' speeds
            allow, rather than asks for a speed that must be had.
        rows: the most rows that it gives.
        names: (rows,) what each row is for.
        margins: of the last update, one for each of `margin_names`; what is negative lies
            outside. In the unit that the class states; inf for what is switched off. Constraints
            on the velocity alone, and equations, have none.
        margin_names: what each margin is of.
        events: how often something happened, by name. All have `outside` (updates with a margin
            below −1e-9) and `started_outside` (first updates after a reset that had one).

    Raises:
        ConfigError: with file "" and the key inside the parameters, which `build` completes.
        FrameNotFoundError: the robot lacks a frame that the parameters name.
    """

    class Parameters(Settings):
        """Settings of this constraint; none here."""

    equality: ClassVar[bool] = False
    yields: ClassVar[bool] = False

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
        self.events = {"outside": 0, "started_outside": 0}
        self._started = False
        self.prepare(parameters, kinematics)

    def prepare(self, parameters: Any, kinematics: Kinematics) -> None:
        """Size the buffers: what a subclass may have instead of an `__init__`.

        Args:
            parameters, kinematics: as `__init__` got them; everything else is set already.
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

    def watch(self, least: float | None = None) -> None:
        """Count where the margins of this update lie outside; `update` or `bounds` calls it.

        Args:
            least: the smallest margin, where it is known already.
        """
        if (self.margin() if least is None else least) < OUTSIDE:
            self.events["outside"] += 1
            self.events["started_outside"] += not self._started
        self._started = True

    def check_rate(self, eta_per_s: float) -> None:
        """Refuse a rate η of (25) that oversteps the limit within one period.

        Raises:
            ConfigError: η·T > 1.
        """
        share, period_s = eta_per_s * self.period_s, self.period_s
        if share > 1.0:
            problem = f"η·T = {share:.6g} oversteps the limit within one period of {period_s:g} s"
            remedy = f"At most 1/T = {1.0 / period_s:.17g}"
            raise ConfigError("", "eta_per_s", eta_per_s, problem, remedy)

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
