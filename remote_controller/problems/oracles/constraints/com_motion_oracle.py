"""Constraints on how the centre of mass speeds up: c̈ = (J·u − ċ_before)/T in a sole's frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.barrier_oracle import Area
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    Constraint,
    Rows,
    sides,
)
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import SOURCES
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError

Array = NDArray[np.float64]

COM_MOTION: dict[str, Any] = {"gravity_m_s2": 9.81, "positions_from": SOURCES}
LEAST_HEIGHT = 1e-3  # m: of the centre of mass above the sole


class ComMotion(Constraint):
    """D·c̈ ≤ b; remembers how the centre of mass moved over the period before.

    ċ_before is J of the cycle before times what the joints really moved since, over the time
    in between; at the first cycle J·dq. A margin is that of the period that has just ended, with
    its c and c̈; where no period is known, c̈ = 0.

    Attributes:
        frame: of the sole that it is seen from.
    """

    frame: str

    has_rows: ClassVar[bool] = True
    has_memory: ClassVar[bool] = True

    def begin(self, state: Any) -> None:
        """Nothing is known of a period before."""
        self._before: tuple[int, Array, Array, Array, Array] | None = None

    def take_over(self, other: Constraint) -> None:
        """Keep the motion of the period before."""
        if isinstance(other, ComMotion):
            self._before = other._before

    def rows(self, state: Any, number: int) -> Rows:
        """Rows for the next period, and the margin of the last one."""
        c, J = self.robot.com(self.frame)
        q, tick = self.positions(state), int(state["tick"])
        T, change, where = self.description.period_s, np.zeros(3), c
        if self._before is None:
            speed = J @ state["dq"]
        else:
            last, q_last, c_last, J_last, speed_last = self._before
            ticks = max(tick - last, 1)
            speed = J_last @ ((q - q_last) / (ticks * T))
            if ticks == 1:
                change, where = speed - speed_last, c_last
        self._before = tick, q.copy(), c, J, speed
        self.margins[number] = self.inside(where, change / T).min()
        D, b = self.limit(c)
        return Rows(D @ J, T * b + D @ speed, np.ones(len(b), bool))

    def follow(self, state: Any) -> None:
        """Find the margin of the last period, with ċ = J·q̇."""
        c, J = self.robot.com(self.frame)
        q, tick, speed = np.array(state["q"]), int(state["tick"]), J @ state["dq"]
        change, where = np.zeros(3), c
        if self._before is not None:
            last, _, c_last, _, speed_last = self._before
            if last == tick:
                return
            if last + 1 == tick:
                change, where = speed - speed_last, c_last
        self._before = tick, q, c, J, speed
        self.margins = self.inside(where, change / self.description.period_s)

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """Rows of c̈ = J·q̈ + J̇·q̇."""
        c, J = self.robot.com(self.frame)
        D, b = self.limit(c)
        size = 1.0 + float(np.abs(b).max(initial=0.0))
        return sides(D @ J, -np.inf, b - D @ self.robot.com_drift(self.frame), dq, size)

    @abstractmethod
    def limit(self, c: Array) -> tuple[Array, Array]:
        """D (k, 3) and b (k,) of D·c̈ ≤ b where the centre of mass is at c, (3,) [m]."""

    @abstractmethod
    def inside(self, c: Array, acceleration: Array) -> Array:
        """Margins (k,) of a period with c and c̈, (3,) and (3,)."""


class Zmp(ComMotion):
    """The zero-moment point c − (z/g)·c̈ inside the soles less a margin."""

    defaults: ClassVar[Mapping[str, Any]] = {**COM_MOTION, "soles": None, "margin_m": 0.005}

    def prepare(self) -> None:
        """Find the soles."""
        self._area = Area(self)
        self.frame = self._area.frame
        period, g = self.description.period_s, self.settings["gravity_m_s2"]
        self.amplifies = 1.0 + 4.0 / (g * period)  # (z/g)·ċ/T at 1 rad/s and z = 1 m, four J

    def begin(self, state: Any) -> None:
        """Lay out the area where the soles are."""
        super().begin(state)
        self._area.lay_out(self)

    def limit(self, c: Array) -> tuple[Array, Array]:
        """n·c̈ ≤ (g/z)(n·c − o); nothing where the centre of mass is on the ground."""
        if c[2] < LEAST_HEIGHT:
            return np.zeros((0, 3)), np.zeros(0)
        normals = self._area.normals
        flat = np.hstack([normals, np.zeros((len(normals), 1))])
        return flat, self._area.inside(c) * (self.settings["gravity_m_s2"] / c[2])

    def inside(self, c: Array, acceleration: Array) -> Array:
        """n·p − o."""
        return self._area.inside(c - c[2] / self.settings["gravity_m_s2"] * acceleration)


class FrictionCone(ComMotion):
    """The force from the ground in a pyramid of k faces within the cone of friction."""

    defaults: ClassVar[Mapping[str, Any]] = {**COM_MOTION, "mu": 0.5, "faces": 8.0, "sole": None}

    def prepare(self) -> None:
        """Lay out the faces."""
        robot, given = self.description, self.settings
        self.frame = given["sole"] or robot.base_frame
        if self.frame not in [sole.frame for sole in robot.soles]:
            raise UnverifiableError(f"{self.frame!r:.40} is no sole")
        k = int(given["faces"])
        share = given["mu"] * np.cos(np.pi / k)
        turns = np.exp(2j * np.pi * np.arange(k) / k)
        self._faces = np.stack([turns.real, turns.imag, np.full(k, -share)], axis=1)
        self.amplifies = 4.0 / self.description.period_s
        self._weight = np.full(k, share * given["gravity_m_s2"])

    def limit(self, c: Array) -> tuple[Array, Array]:
        """d·c̈_xy − μ'c̈_z ≤ μ'g."""
        return self._faces, self._weight

    def inside(self, c: Array, acceleration: Array) -> Array:
        """μ'(g + c̈_z) − d·c̈_xy."""
        return np.asarray(self._weight - self._faces @ acceleration)
