"""Which certificates count: their fields must be numbers that can be true."""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import Setpoint, schema

STATUS = {
    name.removeprefix("STATUS_").lower(): value
    for name, value in schema("Setpoint").constants.items()
    if name.startswith("STATUS_")
}
"""Setpoint.solver_status by name: certified, at_target, uncertified, infeasible, none."""
PROVED = STATUS["certified"], STATUS["at_target"]
INVALID = "invalid certificate: "
"""Begin of the reason why an answer with an invalid field is not certified."""
STATIONARY = "stationary: "
"""Begin of the conditions of tasks whose gradient vanishes: no answer is certified in these."""
BLOCKED = "blocked: "
"""Begin of the conditions that bounds or constraints keep a task from progress."""
RHO_MAX = 1.0 + 1e-9
RESIDUAL_MAX = 1e-9
RATE_ABSOLUTE, RATE_RELATIVE = 1e-12, 1e-9  # rounding of v_rate_predicted
FIELDS = ("v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual", "values")


def invalid_field(answer: Setpoint) -> str:
    """Return the first field that makes the certificate of an answer invalid; "" for none.

    Valid are V >= 0, finite rates of which the predicted one is at most the required one, but for
    rounding, 0 <= rho <= 1, a margin that is a number (inf without constraints), a residual from 0
    to 1e-9, and finite values. The status must be defined; only an answer that claims a proof has a
    certificate.
    """
    status = answer.solver_status
    if status not in PROVED:
        return "" if status < len(STATUS) else "solver_status"
    v, required, predicted, rho, margin, residual = answer.certificate.tolist()
    rounding = RATE_ABSOLUTE + RATE_RELATIVE * max(abs(required), abs(predicted))
    valid = (
        0.0 <= v < inf,
        isfinite(required),
        isfinite(predicted) and predicted <= required + rounding,
        0.0 <= rho <= RHO_MAX,
        margin > -inf,
        0.0 <= residual <= RESIDUAL_MAX,
        all(map(isfinite, answer.values.tolist())),
    )
    return "" if all(valid) else FIELDS[valid.index(False)]


def checked_status(answer: Setpoint) -> tuple[int, frozenset[str]]:
    """Return the status that counts, and the reason if it is not the status of the answer."""
    field, status = invalid_field(answer), answer.solver_status
    if not field:
        return status, frozenset()
    return STATUS["uncertified"] if status in PROVED else status, frozenset([INVALID + field])


def checked_statuses(answers: Any) -> NDArray[Any]:
    """Return the status that counts of each answer of a structured array."""
    v, rho, residual = answers["v"], answers["rho"], answers["kkt_residual"]
    required, predicted = answers["v_rate_required"], answers["v_rate_predicted"]
    rounding = RATE_ABSOLUTE + RATE_RELATIVE * np.maximum(abs(required), abs(predicted))
    with np.errstate(invalid="ignore"):
        falls = predicted <= required + rounding
    valid = (
        ((v >= 0.0) & (v < inf))
        & (np.isfinite(required) & np.isfinite(predicted) & falls)
        & ((rho >= 0.0) & (rho <= RHO_MAX))
        & (answers["margin"] > -inf)
        & ((residual >= 0.0) & (residual <= RESIDUAL_MAX))
        & np.isfinite(answers["values"]).all(axis=1)
    )
    status = answers["solver_status"]
    return np.where(np.isin(status, PROVED) & ~valid, STATUS["uncertified"], status)
