"""Quantities that shall not become negative, by equation (25)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

ETA_FIELD: Any = Field(
    10.0,
    gt=0,
    description="η of (25), at most 1/period [1/s]; for accelerations at most 0.6/period, "
    "and this default no more than joints can brake with",
    json_schema_extra=CHANGEABLE,
)
RESERVE_FIELD: Any = Field(
    1e-5, ge=0, description="kept for the curvature that one Euler step does not see [m]"
)
RETURN_SPEED_FIELD: Any = Field(
    0.05,
    gt=0,
    description="fastest return from outside that is asked for [m/s]",
    json_schema_extra=CHANGEABLE,
)
"""Settings of all constraints by (25)."""


class Barrier(Constraint):
    """Rows that keep margins m(q) ≥ 0 [m]; a subclass gives m and A = −∇m in `look`.

    For velocities: A·u ≤ b, where for m ≥ 0 b = η·m, (25). In discrete time, for an m that is
    linear in q, ηT ≤ 1 keeps it. A curved one loses up to cT² more in an Euler step of length T,
    with c = max |d²m/dt²|/2 along the step. A reserve r is kept for this: b = η·max(m − r, 0) where
    m ≥ 0, so u = 0 is allowed inside and on the limit. The reserve lasts for r/(cT²) periods at the
    limit; after that m ≥ −cT/η − cT².

    For accelerations: m̈ ≥ −2ηṁ − η²·max(m − r, 0), that is A·q̈ ≤ 2ηṁ + η²·max(m − r, 0) − Ȧ·q̇.
    It keeps m ≥ 0 and ṁ ≥ −η·m where both hold already: with x = ηT a period leads from ṁ = −ηm to
    ṁ + ηm = ηm·x²/2, and from m = 0 to ṁ·(1 − x − x²) at least, so for a linear m this is invariant
    if and only if x ≤ (√5 − 1)/2; x ≤ 0.6 is enforced. The reserve then is for the third order,
    |d³m/dt³|·T³/6 a period. To follow it, joints must brake with η times their speed: an η that
    asks for more than they can is refused, or lowered where it is not set.

    Outside, m < 0, the row asks for the way back, η·max(m, −return speed/η), and events count it.
    Where no joint moves m, such a row would have no answer: it is switched off, and the event
    `immovable` counts it; its margin stays negative for all to see.

    That the robot can stop in time is judged by looks along the stop, which are near enough if no
    joint changes m faster than `reach` says (`coordinated_stop`): set it where m is more sensitive
    than the place of a point.
    """

    yields = True
    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "conditional"
    margin_unit = "m"

    class Parameters(Constraint.Parameters):
        """How fast limits may be approached, and how fast one returns behind them."""

        eta_per_s: float = ETA_FIELD
        reserve_m: float = RESERVE_FIELD
        return_speed_m_s: float = RETURN_SPEED_FIELD

    def prepare(self, parameters: Any, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints import limit_kernels as kernels

        self._limit_rows, self._limit_accelerations = (
            kernels.limit_rows,
            kernels.limit_accelerations,
        )
        self._reserve = parameters.reserve_m
        self._brakes: tuple[FloatArray, FloatArray] | None = None  # where rows are of accelerations
        self.apply(parameters)
        self.events["immovable"] = 0

    def apply(self, parameters: Any) -> None:
        """Read η and the speed of the return."""
        self._eta = self.rate_of(parameters, self._brakes)
        self._return_speed = parameters.return_speed_m_s

    def name_rows(self, names: tuple[str, ...]) -> None:
        """One row and one margin for each name."""
        self.rows, self.names, self.margin_names = len(names), names, names
        self.margins = np.full(self.rows, np.inf)

    def look(self, kinematics: Kinematics, margins_out: FloatArray, A_out: FloatArray) -> None:
        """Write m and A = −∇m of a posture; this alone, for it is also asked about others nearby.

        Args:
            kinematics: up to date; the frames' numbers are those of every `Kinematics`.
            margins_out: (rows,) m; inf for what is switched off.
            A_out: (rows, n), C-contiguous, in wire order.
        """
        raise NotImplementedError

    def begin(self, kinematics: Kinematics) -> None:
        """Before the first look after a reset: keep what shall stay as it is now."""

    def judge(self, kinematics: Kinematics) -> None:
        """After the look at the robot's own posture: count what happened in `events`."""

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write one row for each margin."""
        self._look(kinematics, A_out)
        self.limit(A_out, b_out)

    def limit(self, A_out: FloatArray, b_out: FloatArray) -> None:
        """Finish rows of velocities whose A_out holds −∇m already, from `self.margins`."""
        least, immovable = self._limit_rows(
            self.margins, self._eta, self._reserve, self._return_speed, A_out, b_out
        )
        self.events["immovable"] += immovable
        self.watch(least)

    @classmethod
    def serves(cls, level: Level) -> bool:
        """One that overrides `update` alone serves velocities alone."""
        return level in cls.levels and (level == "velocity" or cls.look is not Barrier.look)

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Fit η to the period and the brakes, and size the buffers."""
        self._brakes = speed, deceleration
        self.apply(self.parameters)
        self._rates, self._bend, self._spare = np.zeros((3, self.rows))
        self._row_ahead, self._row_behind = np.zeros((2, self.rows, self.n))

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write one row for each margin."""
        self._look(motion.kinematics, G_out)
        self._bend[:] = 0.0
        if motion.moves:
            self.bend(motion, self._bend)
        lower_out[:] = -np.inf
        least, immovable = self._limit_accelerations(
            self.margins,
            motion.dq,
            self._bend,
            self._eta,
            self._reserve,
            self._return_speed,
            G_out,
            upper_out,
        )
        self.events["immovable"] += immovable
        self.watch(least)

    def margins_at(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write m of any posture."""
        self.look(kinematics, out, self._row_ahead)

    def bend(self, motion: Motion, out: FloatArray) -> None:
        """Write Ȧ·q̇, (rows,) [m/s²]; by looks to either side unless a subclass knows better."""
        ahead, behind, apart_s = motion.aside()
        self.look(ahead, self._spare, self._row_ahead)
        self.look(behind, self._spare, self._row_behind)
        np.subtract(self._row_ahead, self._row_behind, out=self._row_ahead)
        np.dot(self._row_ahead, motion.dq, out=out)
        out /= apart_s

    def _look(self, kinematics: Kinematics, A_out: FloatArray) -> None:
        if not self._started:
            self.begin(kinematics)
        self.look(kinematics, self.margins, A_out)
        self.judge(kinematics)
