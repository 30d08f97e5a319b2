"""QP12 by OSQP: the paper's peer, as a solver of a loop (Table I of the QP12 paper).

With x_i = −sign(gradient_i)·sign(decrease)·u_i and a_i = |gradient_i|/max|gradient| the problem
has no absolute values: min γ·1ᵀx + (1−γ)/2·|x|² such that aᵀx = |decrease|/max|gradient|, x ≥ 0
(Lemma 4). It is set up once, then updated and warm-started.

OSQP's tolerances are absolute, so x is solved for in a unit near its own size, a power of 16, the
equation is divided by its right side, and the objective by its larger weight. Both weights change
only where γ or that unit does; from call to call only the row of the equation is new.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError

FIRST_RHO = 0.1  # OSQP's own default; it adapts it as it goes
LARGEST = 1e300  # of |decrease|/max|gradient|


def canonical_model(
    n: int, linear: float, quadratic: float, tolerance: float, **settings: float
) -> tuple[Any, NDArray[np.int32]]:
    """OSQP for min linear·1ᵀx + quadratic/2·|x|² such that aᵀx = 1, x ≥ 0; a is 1 at first.

    Args:
        n: number of unknowns.
        linear, quadratic: weights of the objective.
        tolerance: absolute and relative.
        settings: further ones, by OSQP's names.

    Returns:
        The model, warm-started from call to call, and the places of a in its matrix, (n,), which
        counts column by column.
    """
    import osqp
    from scipy import sparse

    lower, upper = np.zeros(n + 1), np.full(n + 1, np.inf)
    lower[0] = upper[0] = 1.0
    model: Any = osqp.OSQP()
    model.setup(
        P=quadratic * sparse.eye(n, format="csc"),
        q=np.full(n, linear),
        A=sparse.vstack([sparse.csc_matrix(np.ones((1, n))), sparse.eye(n)], "csc"),
        l=lower,
        u=upper,
        verbose=False,
        rho=FIRST_RHO,
        eps_abs=tolerance,
        eps_rel=tolerance,
        check_termination=5,
        scaling=0,
        warm_starting=True,
        **settings,
    )
    return model, 2 * np.arange(n, dtype=np.int32)


class OsqpQp12:
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that gradient·u = −decrease, by operator splitting.

    The last digits of an answer depend on what was solved before, because OSQP starts from there;
    `forget` resets it to a cold start.

    Args:
        n: number of joints.
        tolerance: absolute and relative tolerance of OSQP; its own default is 1e-3.
        polish: solve once more for the joints that were found to move: exact if they are the right
            ones.
        max_iterations: after so many OSQP gives up.

    Attributes:
        iterations: of the last solve.
    """

    def __init__(
        self, n: int, tolerance: float = 1e-5, *, polish: bool = True, max_iterations: int = 4000
    ) -> None:
        from osqp import SolverStatus

        self.n, self.iterations = n, 0
        self._linear, self._quadratic = np.zeros(n), np.ones(n)
        self._weights = (0.0, 1.0)  # γ, unit of x
        self._model, self._entries = canonical_model(
            n, 0.0, 1.0, tolerance, polishing=polish, max_iter=max_iterations
        )
        self._solved = SolverStatus.OSQP_SOLVED

    def forget(self) -> None:
        """Begin the next solve as a new solver would."""
        self._model.update_settings(rho=FIRST_RHO)
        self._model.warm_start(np.zeros(self.n), np.zeros(self.n + 1))

    def solve(
        self, gradient: NDArray[np.float64], decrease: float, gamma: float, out: NDArray[np.float64]
    ) -> None:
        """Write u, (n,), into `out`; zeros where an error is raised.

        Raises:
            InfeasibleError: the gradient is zero and the decrease is not.
            BadProblemError: something is not finite, γ is not in [0, 1], the answer would be
                beyond 1e300, or OSQP gave up.
        """
        out[:] = 0.0
        self.iterations = 0
        size = np.abs(gradient)
        top = float(size.max())
        if not (math.isfinite(top) and math.isfinite(decrease) and 0.0 <= gamma <= 1.0):
            raise BadProblemError("OSQP: gradient, decrease and gamma in [0, 1] must be finite")
        if decrease == 0.0:
            return
        if top == 0.0:
            raise InfeasibleError("OSQP: no input changes V: the gradient is zero")
        scale = abs(decrease) / top
        if scale > LARGEST:
            raise BadProblemError("OSQP: so small a gradient needs an input beyond 1e300")
        if scale == 0.0:  # below the smallest number there is
            return
        unit = 2.0 ** (math.frexp(scale)[1] // 4 * 4)
        size /= top
        size *= unit / scale
        changes = {"Ax": size, "Ax_idx": self._entries}
        if (gamma, unit) != self._weights:
            changes |= self._weigh(gamma, unit)
        self._model.update(**changes)
        result = self._model.solve(raise_error=False)
        self.iterations = int(result.info.iter)
        if result.info.status_val != self._solved:
            raise BadProblemError(f"OSQP: {result.info.status}")
        np.multiply(np.sign(gradient), result.x, out=out)
        out *= -unit if decrease > 0.0 else unit

    def _weigh(self, gamma: float, unit: float) -> dict[str, NDArray[np.float64]]:
        """Both weights of the objective, the larger of them 1."""
        self._weights = (gamma, unit)
        even = (1.0 - gamma) * unit
        larger = max(gamma, even)
        self._linear[:] = gamma / larger
        self._quadratic[:] = even / larger
        return {"q": self._linear, "Px": self._quadratic}
