"""The answers of one controller as columns, with what their certificates state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray, Setpoint
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.certificate import PROVED, STATUS, checked_statuses
from hoap3.tools.logs.disk_rows import disk_array, parts

UNITS = {0: "rad/s", 1: "rad/s²", 2: "N m"}
"""Of the control inputs, by `Setpoint.command`; for a prismatic joint read m for rad."""


@dataclass
class AnswerSeries:
    """One row for each of k answers, in the order of ticks.

    Attributes:
        tick: (k,), of the States that were answered.
        time_s: (k,), their intended start, from the start of the series on.
        status: (k,), of the certificates; a log may hold other numbers than those of `STATUS`.
        v, psi, rho, margin: (k,), V, Ψ = −(required V̇), ρ and the smallest margin; NaN without a
            certificate.
        inputs: (k, n), u, in `unit`.
    """

    tick: NDArray[np.uint64]
    time_s: FloatArray
    status: NDArray[np.uint32]
    v: FloatArray
    psi: FloatArray
    rho: FloatArray
    margin: FloatArray
    inputs: FloatArray
    unit: str

    @property
    def proved(self) -> NDArray[np.bool_]:
        """(k,) whether there is a certificate, so that V, ρ and the margin are known."""
        return np.asarray(self.status != STATUS["none"])

    @property
    def certified(self) -> NDArray[np.bool_]:
        """(k,) whether the certificate holds."""
        return np.isin(self.status, PROVED)


def read_answers(
    states: Any, answers: Any, description: RobotDescription, parameters: dict[str, Any], start: int
) -> AnswerSeries:
    """Read the columns of answers.

    Args:
        states: that were answered, rows of a log.
        answers: first Setpoint to each of them.
        description: of the robot.
        parameters: of the controller, which say where its setpoints are integrated from.
        start: of the series [ns].
    """
    inputs, unit = control_inputs(states, answers, description, parameters)
    status = checked_statuses(answers)
    v, psi, rho, margin = (
        np.where(status == STATUS["none"], np.nan, values)
        for values in (
            answers["v"],
            0.0 - answers["v_rate_required"],
            answers["rho"],
            answers["margin"],
        )
    )
    time_s = seconds_since(start, states)
    return AnswerSeries(answers["tick"], time_s, status, v, psi, rho, margin, inputs, unit)


def pair_answers(states: Any, setpoints: Any) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Places of the States that have an answer, in order of ticks, and of the first answer to each.

    Args:
        states, setpoints: rows of one session; of States one a tick.
    """
    ticks, first = np.unique(setpoints["tick"], return_index=True)
    _, of_states, of_ticks = np.intersect1d(states["tick"], ticks, return_indices=True)
    return of_states, first[of_ticks]


def seconds_since(start: int, states: Any) -> FloatArray:
    """Intended start of States, from a stamp [ns] on [s]."""
    return np.asarray((states["stamp_intended"] - start) / 1e9, float)


def control_inputs(
    states: Any, answers: Any, description: RobotDescription, parameters: dict[str, Any]
) -> tuple[FloatArray, str]:
    """u, (k, n), and its unit: of a position its rate, from where the controller integrates."""
    n = description.n
    inputs = disk_array((len(answers), n))  # 100 MB of ten minutes of 21 joints
    if answers.dtype["values"].shape[0] < n:
        return inputs, UNITS[0]
    command = int(answers["command"][0]) if len(answers) else Setpoint.POSITION
    start = "q" if parameters.get("integrate_from") == "measured" else "reference"
    for part in parts(len(answers)):  # a long log has more columns than fit into memory at once
        inputs[part] = answers[part]["values"][:, :n]
        if command == Setpoint.POSITION:
            inputs[part] -= states[part][start]
            inputs[part] /= description.period_s
    return inputs, UNITS.get(command, "unknown unit")
