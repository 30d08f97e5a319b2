"""Quantities that shall not become negative, by equation (25)."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.model.kinematics import Kinematics


class Barrier(Constraint):
    """Rows that keep margins m(q) = −h(q) ≥ 0 [m]: −∇m·u ≤ b, where for m ≥ 0 b = η·m.

    (25) in discrete time: for an m that is linear in q, ηT ≤ 1 keeps it. A curved one loses up to
    cT² more in an Euler step of length T, with c = max |d²m/dt²|/2 along the step. A reserve r is
    kept for this: b = η·max(m − r, 0) where m ≥ 0, so u = 0 is allowed inside and on the limit.
    The reserve lasts for r/(cT²) periods at the limit; after that m ≥ −cT/η − cT².

    Outside, m < 0, the row asks for the way back, −∇m·u ≤ max(η·m, −return speed), and events
    count it. Where no joint moves m, such a row would have no answer: it is switched off, and the
    event `immovable` counts it; its margin stays negative for all to see.
    """

    yields = True

    class Parameters(Constraint.Parameters):
        """How fast limits may be approached, and how fast one returns behind them."""

        eta_per_s: float = Field(10.0, gt=0, description="η of (25), at most 1/period [1/s]")
        reserve_m: float = Field(
            1e-5, ge=0, description="kept for the curvature that one Euler step does not see [m]"
        )
        return_speed_m_s: float = Field(
            0.05, gt=0, description="fastest return from outside that is asked for [m/s]"
        )

    def prepare(self, parameters: Any, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints.limit_kernels import limit_rows

        self._limit_rows = limit_rows
        self.check_rate(parameters.eta_per_s)
        self._eta, self._reserve = parameters.eta_per_s, parameters.reserve_m
        self._return_speed = parameters.return_speed_m_s
        self.events["immovable"] = 0

    def name_rows(self, names: tuple[str, ...]) -> None:
        """One row and one margin for each name."""
        self.rows, self.names, self.margin_names = len(names), names, names
        self.margins = np.full(self.rows, np.inf)

    def limit(self, A_out: FloatArray, b_out: FloatArray) -> None:
        """Finish rows whose A_out holds −∇m already, from `self.margins`."""
        least, immovable = self._limit_rows(
            self.margins, self._eta, self._reserve, self._return_speed, A_out, b_out
        )
        self.events["immovable"] += immovable
        self.watch(least)
