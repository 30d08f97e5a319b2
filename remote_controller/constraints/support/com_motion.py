"""How the centre of mass moves, for constraints on the force from the ground."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import (
    Constraint,
    Guarantee,
    Level,
    PositionSource,
    positions,
)
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion


class ComMotion(Constraint):
    """Rows of c̈ = J·q̈ + J̇·q̇, or of (J·u − ċ_prev)/T, in the frame of a sole, z up.

    For velocities ċ_prev is the velocity that the centre of mass really had: J of the previous
    update times (q − q_prev)/(ticks between·T), with q the applied reference (or the measured
    position). At the first update it is J·dq of the state. So a held or filtered setpoint is seen
    one tick later. Margins are those of the period that has just ended, with its c and its c̈; where
    no period is known, at the first update and across missed ticks, c̈ = 0. For accelerations
    ċ = J·dq.

    u = 0 is not always allowed: from ċ ≠ 0 it asks for c̈ = −ċ/T.

    Attributes:
        com, jacobian: c (3,) [m] and J (3, n) of the last update.
    """

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "at the tick"

    class Parameters(Constraint.Parameters):
        """Gravity, and what moves."""

        gravity_m_s2: float = Field(9.81, gt=0, description="acceleration of free fall g [m/s²]")
        positions_from: PositionSource = Field(
            "reference", description="joint positions that velocities are computed from"
        )

    def prepare(self, parameters: Any, kinematics: Kinematics) -> None:
        """Size the buffers; a subclass then has names and margins."""
        self._gravity, self._source = parameters.gravity_m_s2, parameters.positions_from
        self.events["ticks_missed"] = 0
        self._frame = 0
        self._tick, self._is_known = 0, False
        self._q, self._dq = np.zeros(self.n), np.zeros(self.n)
        self.com, self._com_before = np.zeros(3), np.zeros(3)
        self.jacobian, self._jacobian_before = np.zeros((3, self.n)), np.zeros((3, self.n))
        self._speed, self._speed_before = np.zeros(3), np.zeros(3)
        self._drift, self._change = np.zeros(3), np.zeros(3)

    def name_rows(self, names: tuple[str, ...], frame: int) -> None:
        """One row and one margin for each name, in a frame that `frame_id` gave."""
        self._frame, self.rows = frame, len(names)
        self.names = self.margin_names = names
        self.margins = np.full(self.rows, np.inf)

    def reset(self) -> None:
        """Forget the previous states, and where the soles were."""
        super().reset()
        self._is_known = False

    def begin(self, kinematics: Kinematics) -> None:
        """Before the first look after a reset."""

    def look_around(self, kinematics: Kinematics) -> None:
        """Before each later look."""

    @abstractmethod
    def judge(self, com: FloatArray, change: FloatArray) -> None:
        """Write the margins of a period with this c (3,) [m] and change of ċ (3,) [m/s]."""

    @abstractmethod
    def limit(self, A_out: FloatArray, b_out: FloatArray, T: float) -> bool:
        """Write A·q̈·T ≤ b, as if J̇·q̇ were 0, of `com` and `jacobian`; whether rows are on."""

    @abstractmethod
    def of(self, motion: FloatArray) -> FloatArray:
        """What rows A make of an acceleration of the centre of mass, (3,): (rows,)."""

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write the rows for c̈ = (J·u − ċ_prev)/T."""
        if self._follow(kinematics, state):
            self._differentiate(state)
            self._judge_period()
        if self.limit(A_out, b_out, self.period_s):
            b_out += self.of(self._speed)

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write the rows for c̈ = J·q̈ + J̇·q̇."""
        if self._follow(motion.kinematics, state):
            self._is_known = self._started and int(state.tick) == self._tick + 1
            np.dot(self.jacobian, motion.dq, out=self._speed)
            self._tick = int(state.tick)
            self._judge_period()
        lower_out[:] = -np.inf
        if self.limit(G_out, upper_out, 1.0) and motion.moves:
            motion.com_drift(self._frame, self._drift)
            upper_out -= self.of(self._drift)

    def _follow(self, kinematics: Kinematics, state: State) -> bool:
        """Find c and J; whether the State is another than the last one."""
        if not self._started:
            self.begin(kinematics)
        else:
            self.look_around(kinematics)
        if self._started and int(state.tick) == self._tick:
            kinematics.com(self._frame, self.com, self.jacobian)
            return False
        self._com_before[:], self._jacobian_before[:] = self.com, self.jacobian
        self._speed_before[:] = self._speed
        kinematics.com(self._frame, self.com, self.jacobian)
        return True

    def _differentiate(self, state: State) -> None:
        """Find ċ_prev, (3,) [m/s], and keep what the next update needs."""
        q = positions(state, self._source)
        if not self._started:
            np.dot(self.jacobian, state.dq, out=self._speed)
        else:
            ticks = max(int(state.tick) - self._tick, 1)
            self._is_known = ticks == 1
            self.events["ticks_missed"] += ticks - 1
            np.subtract(q, self._q, out=self._dq)
            self._dq /= ticks * self.period_s
            np.dot(self._jacobian_before, self._dq, out=self._speed)
        self._q[:], self._tick = q, int(state.tick)

    def _judge_period(self) -> None:
        """Margins of the period that has just ended."""
        if self._is_known:
            np.subtract(self._speed, self._speed_before, out=self._change)
            self.judge(self._com_before, self._change)
        else:
            self._change[:] = 0.0
            self.judge(self.com, self._change)
        self.watch()
