"""What one controller did, tick by tick, as the figures need it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import COM, RobotDescription
from hoap3.protocol.messages import FloatArray, Setpoint
from hoap3.remote_controller.controllers.base import ACTIVE_SPEED, STATUS
from hoap3.remote_controller.controllers.certificate import checked_statuses
from hoap3.tools.compare.answers import Answers, Rows
from hoap3.tools.report.motion import UNITS, control_inputs, point_path

EMPTY = np.empty((0, 0))
ROUNDING = 1e-9  # of a position [rad or m] or speed, that is no violation of a limit
SPEED = UNITS[Setpoint.POSITION]


@dataclass(frozen=True)
class Series:
    """One row for each of k answers.

    Attributes:
        period_s: for how long an answer counts [s].
        time_s: (k,) since the first.
        inputs: (k, n) u.
        status: (k,) of the certificates, values of `STATUS`.
        v, rho, margin: (k,) V, ρ and smallest margin, as the certificates have them.
        position, speed: (k,) joints that the answer sends beyond a limit of the robot; None where
            u is no speed, and only the robot knows.
        unit: of u.
        com_m: (k, 3) centre of mass of the applied reference, in the robot's base frame, or empty.
        reference: (k, n) applied reference, or empty.
    """

    period_s: float
    time_s: FloatArray
    inputs: FloatArray
    status: NDArray[np.int64]
    v: FloatArray
    rho: FloatArray
    margin: FloatArray
    position: NDArray[np.int64] | None
    speed: NDArray[np.int64] | None
    unit: str = SPEED
    com_m: FloatArray = field(default_factory=lambda: EMPTY)
    reference: FloatArray = field(default_factory=lambda: EMPTY)

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def proved(self) -> NDArray[np.bool_]:
        """(k,) whether there is a certificate at all, so that V, ρ and margin say something."""
        return np.asarray(self.status != STATUS["none"])

    @cached_property
    def lyapunov(self) -> FloatArray:
        """(k,) V; NaN where nobody says what it is, or it is no such value."""
        with np.errstate(invalid="ignore"):
            return np.where(self.proved & (self.v >= 0.0) & (self.v < np.inf), self.v, np.nan)

    @cached_property
    def error(self) -> FloatArray:
        """(k,) √(2V)."""
        return np.asarray(np.sqrt(2.0 * self.lyapunov))

    @cached_property
    def control_effort(self) -> FloatArray:
        """(k,) |u|₁."""
        return np.asarray(np.abs(self.inputs).sum(axis=1))

    @cached_property
    def moving(self) -> NDArray[np.bool_] | None:
        """(k, n) joints with |u| ≥ 0.001 rad/s; None where u is no speed."""
        return np.abs(self.inputs) >= ACTIVE_SPEED if self.unit == SPEED else None

    @cached_property
    def active(self) -> FloatArray | None:
        """(k,) how many they are."""
        return None if self.moving is None else self.moving.sum(axis=1).astype(float)

    @cached_property
    def switched(self) -> FloatArray | None:
        """(k,) joints that became active, or stopped being so, since the answer before."""
        if self.moving is None:
            return None
        changes = (self.moving[1:] != self.moving[:-1]).sum(axis=1)
        return np.concatenate([np.zeros(min(1, len(self))), changes])

    @cached_property
    def unproved(self) -> NDArray[np.bool_]:
        """(k,) answers that should have a certificate that holds, and have none."""
        return np.isin(self.status, (STATUS["uncertified"], STATUS["infeasible"]))


def read_series(answers: Answers, parameters: dict[str, Any]) -> Series:
    """Take from the answers what figures are made of.

    Args:
        answers: of one controller.
        parameters: its own, which say where its setpoints are integrated from.
    """
    description, states, setpoints = answers.description, answers.states, answers.setpoints
    with np.errstate(invalid="ignore", over="ignore"):  # whatever a log has in its States
        inputs, unit = control_inputs(states, setpoints, description, parameters)
        position, speed = _beyond(description, states, setpoints, inputs, unit)
    moved = answers.closed_loop and len(states) > 0
    reference = np.array(states["reference"]) if moved else EMPTY
    stamps = states["stamp_intended"]
    return Series(
        period_s=description.period_s,
        time_s=np.asarray((stamps - stamps[:1].sum()) / 1e9, float),
        inputs=inputs,
        status=checked_statuses(setpoints).astype(np.int64),
        v=np.array(setpoints["v"]),
        rho=np.array(setpoints["rho"]),
        margin=np.array(setpoints["margin"]),
        position=position,
        speed=speed,
        unit=unit,
        com_m=point_path(reference, description, COM, description.base_frame) if moved else EMPTY,
        reference=reference,
    )


def _beyond(
    description: RobotDescription, states: Rows, setpoints: Rows, inputs: FloatArray, unit: str
) -> tuple[NDArray[np.int64] | None, NDArray[np.int64] | None]:
    """(k,) joints beyond a usable position, and beyond their speed; None where u is no speed.

    A joint that starts outside of its usable positions may stay there, but not go further.
    """
    if unit != SPEED:
        return None, None
    before, after = states["reference"], setpoints["values"]
    over = after > np.maximum(description.upper, before) + ROUNDING
    under = after < np.minimum(description.lower, before) - ROUNDING
    fast = np.abs(inputs) > description.velocity + ROUNDING
    return (over | under).sum(axis=1), fast.sum(axis=1)
