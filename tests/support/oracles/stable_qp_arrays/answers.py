"""What was answered in each cycle, and what is claimed of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.sent_velocity import sent_velocity

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

COLUMNS = "psi", "drift", "solver_status"
OK, STATIONARY, ZERO_GRADIENT, INFEASIBLE, CANNOT_DESCEND, DESCENDS_FASTER = 0, 5, 6, 7, 9, 10
"""What `solver_status` says, of `solvers.base.status`."""
PROVEN = (OK, STATIONARY)
ANSWERED = (*PROVEN, CANNOT_DESCEND, DESCENDS_FASTER)
FOLLOWED = (*ANSWERED, ZERO_GRADIENT)  # else the robot brakes


@dataclass(frozen=True)
class Answers:
    """One row for each cycle; where it has no answer the numbers are 0.

    Attributes:
        there: whether there is an answer, (N,).
        tick: of the State, (N,).
        u, doubt: velocities, and how exactly they are known, (N, n) [rad/s or m/s].
        stated: fields of the answer by name, each (N,).
        psi, drift: Ψ and ∂V/∂t as stated, (N,).
        status: of the solver as stated, (N,).
        before: u of the cycle before, (N, n); 0 where there is none.
    """

    there: Flags
    tick: NDArray[np.int64]
    u: Array
    doubt: Array
    stated: Mapping[str, Array]
    psi: Array
    drift: Array
    status: NDArray[np.int64]
    before: Array

    @classmethod
    def of(cls, run: ControllerRun, cycles: Cycles, parameters: Mapping[str, Any]) -> Answers:
        """Those of a run's cycles.

        Raises:
            UnverifiableError: the log does not name the columns of this controller.
        """
        names = list(run.session.get("extra") or ())
        if any(name not in names for name in COLUMNS):
            raise UnverifiableError("the log does not name psi, drift and solver_status")
        there = cycles.answers >= 0
        rows = cycles.answers[there]
        answers = run.answers[rows]
        u, doubt = sent_velocity(run, parameters)

        def spread(values: Any) -> Any:
            whole = np.zeros((len(there), *np.shape(values)[1:]), np.asarray(values).dtype)
            whole[there] = values
            return whole

        status = answers["extra"][:, names.index("solver_status")]
        found = spread(np.where(np.isfinite(status), status, -1.0).astype(np.int64))
        sent = spread(u[rows])
        before = np.vstack([np.zeros((1, u.shape[1])), sent[:-1]])
        before[cycles.fresh] = 0.0
        extra = [spread(answers["extra"][:, names.index(name)]) for name in COLUMNS[:2]]
        fields = (
            *("v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual"),
            "solver_status",
        )
        return cls(
            there,
            run.states["tick"][cycles.places].astype(np.int64),
            sent,
            spread(doubt[rows]),
            {name: spread(answers[name].astype(float)) for name in fields},
            extra[0],
            extra[1],
            found,
            before,
        )
