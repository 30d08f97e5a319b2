"""The zero-moment point inside the soles, after the cart-table model."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import (
    Constraint,
    Guarantee,
    PositionSource,
    positions,
)
from hoap3.remote_controller.constraints.support.support_area import SupportArea
from hoap3.remote_controller.model.kinematics import Kinematics

LEAST_HEIGHT = 1e-3  # m: of the centre of mass above the sole


class Zmp(Constraint):
    """p = c − (z/g)·c̈ inside the support polygon less a margin [m], c̈ = (J·u − ċ_prev)/T.

    Linear in u: for each edge n·p ≥ o, n·J·u ≤ (gT/z)(n·c − o) + n·ċ_prev, in the first sole's
    frame, z up. The mass is taken as a point whose height changes slowly (Kajita's cart-table).

    ċ_prev is the velocity that the centre of mass really had: J of the previous update times
    (q − q_prev)/(ticks between·T), with q the applied reference (or the measured position). At
    the first update it is J·dq of the state. So a held or filtered setpoint is seen one tick
    later, and the margin is that of the ZMP which the last period really had, n·p − o with its c
    and its c̈; where no period is known, at the first update and across missed ticks, p = c.

    u = 0 is not always allowed: from ċ ≠ 0 it asks for c̈ = −ċ/T. Nothing here makes sure that
    a fast centre of mass can still stop inside: limit speeds, or add `support_polygon`.
    """

    guarantee: ClassVar[Guarantee] = "at the tick"

    class Parameters(Constraint.Parameters):
        """Soles, margin and gravity."""

        soles: tuple[str, ...] = Field(
            (), description="frames of the soles on the ground; none: the base frame's"
        )
        margin_m: float = Field(0.005, ge=0, description="kept to every edge [m]")
        gravity_m_s2: float = Field(9.81, gt=0, description="acceleration of free fall g [m/s²]")
        positions_from: PositionSource = Field(
            "reference", description="joint positions that velocities are computed from"
        )

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        self._area = SupportArea(
            self.description, kinematics, parameters.soles, parameters.margin_m
        )
        self._gravity, self._source = parameters.gravity_m_s2, parameters.positions_from
        self.rows = self._area.rows
        self.names = self.margin_names = tuple(f"edge {edge}" for edge in range(self.rows))
        self.margins = np.full(self.rows, np.inf)
        self.events.update(sole_moved=0, ticks_missed=0, too_low=0)
        self._tick, self._is_known = 0, False
        self._q, self._dq = np.zeros(self.n), np.zeros(self.n)
        self._com, self._com_before = np.zeros(3), np.zeros(3)
        self._jacobian, self._jacobian_before = np.zeros((3, self.n)), np.zeros((3, self.n))
        self._speed, self._speed_before = np.zeros(3), np.zeros(3)
        self._zmp = np.zeros(2)

    def reset(self) -> None:
        """Forget the previous states, and where the soles were."""
        super().reset()
        self._is_known = False

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write one row for each edge."""
        area = self._area
        if not self._started:
            area.lay_out(kinematics)
        elif area.has_moved(kinematics):
            self.events["sole_moved"] += 1
        if self._started and int(state.tick) == self._tick:
            kinematics.com(area.frame, self._com, self._jacobian)
        else:
            self._com_before[:], self._jacobian_before[:] = self._com, self._jacobian
            self._speed_before[:] = self._speed
            kinematics.com(area.frame, self._com, self._jacobian)
            self._differentiate(state)
            self._judge()
        if self._com[2] < LEAST_HEIGHT:
            self.events["too_low"] += 1
            A_out[:], b_out[:] = 0.0, np.inf
            return
        np.dot(area.normals, self._com[:2], out=b_out)
        b_out -= area.offsets
        b_out *= self._gravity * self.period_s / self._com[2]
        b_out += area.normals @ self._speed[:2]
        np.dot(area.normals, self._jacobian[:2], out=A_out)

    def _differentiate(self, state: State) -> None:
        """Find ċ_prev, (3,) [m/s], and keep what the next update needs."""
        q = positions(state, self._source)
        if not self._started:
            np.dot(self._jacobian, state.dq, out=self._speed)
        else:
            ticks = max(int(state.tick) - self._tick, 1)
            self._is_known = ticks == 1
            self.events["ticks_missed"] += ticks - 1
            np.subtract(q, self._q, out=self._dq)
            self._dq /= ticks * self.period_s
            np.dot(self._jacobian_before, self._dq, out=self._speed)
        self._q[:], self._tick = q, int(state.tick)

    def _judge(self) -> None:
        """Margins of the ZMP of the period that has just ended."""
        self._zmp[:] = self._com[:2]
        if self._is_known:
            height = self._com_before[2] / (self._gravity * self.period_s)
            self._zmp[:] = self._com_before[:2]
            self._zmp -= height * (self._speed[:2] - self._speed_before[:2])
        np.dot(self._area.normals, self._zmp, out=self.margins)
        self.margins -= self._area.offsets
        self.watch()
