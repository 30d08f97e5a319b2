"""The joint velocities that a log states of an answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.statement import Array, Claim

ROUNDINGS = 8  # ulp of the reference that an answer may be off, per period
ACTIVE = 1e-3  # rad/s: from which on a joint counts as active
RELATIVE = 1e-9  # of what is compared: rounding
DELAYED = "answers are delayed: where u starts from is not in the log"


@dataclass(frozen=True)
class VelocityAnswer:
    """Velocity u of an answer, which is integrated to a setpoint: values = start + u·T.

    Where a log lacks u itself, the `decision`, u = (values − start)/T, rounded by some ulp of the
    position.

    Attributes:
        u, error: (n,), u and how exactly it is known [rad/s or m/s].
        values, start: setpoint and where it starts from, (n,) [rad or m].
        period_s: T.
        active_joints: as stated.
    """

    u: Array
    error: Array
    values: Array
    start: Array
    period_s: float
    active_joints: int

    @classmethod
    def of(
        cls, state: Any, setpoint: Any, parameters: Mapping[str, Any], period_s: float
    ) -> VelocityAnswer:
        """Of an answer to a State; `integrate_from` of the parameters says where it starts."""
        measured = parameters.get("integrate_from", "reference") == "measured"
        start, values = state["q" if measured else "reference"], setpoint["values"]
        size = np.maximum(np.abs(start), np.abs(values))
        u, error = (values - start) / period_s, ROUNDINGS * np.spacing(size) / period_s
        if setpoint["decision"].shape == u.shape:
            u, error = setpoint["decision"], np.zeros_like(error)
        return cls(u, error, values, start, period_s, int(setpoint["active_joints"]))

    def claims(self) -> list[Claim]:
        """The setpoint follows from u where the log has u; and the number of active joints."""
        claims = []
        if not self.error.any():
            expected = self.start + self.u * self.period_s
            off = np.abs(self.values - expected)
            allowed = np.spacing(np.maximum(np.abs(self.start), np.abs(self.values)))
            worst = int(np.argmax(off / allowed))
            numbers = float(self.values[worst]), float(expected[worst]), float(allowed[worst])
            claims.append(Claim("setpoint", *numbers))
        speed, near = np.abs(self.u), np.maximum(self.error, RELATIVE * ACTIVE)
        most = float(np.count_nonzero(speed >= ACTIVE - near))
        least, stated = float(np.count_nonzero(speed >= ACTIVE + near)), float(self.active_joints)
        claims.append(Claim("active joints, at most", stated, most, 0.0, "at_most"))
        claims.append(Claim("active joints, at least", stated, least, 0.0, "at_least"))
        return claims
