"""QP12 by OSQP: the paper's peer, as a solver of a loop (Table I of the QP12 paper).

With x_i = −sign(gradient_i)·sign(decrease)·u_i and a_i = |gradient_i|/max|gradient| the problem
has no absolute values: min γ·1ᵀx + (1−γ)/2·|x|² such that aᵀx = |decrease|/max|gradient|, x ≥ 0
(Lemma 4). It is set up once, then updated and warm-started.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.errors import BadProblemError, InfeasibleError


class OsqpQp12:
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that gradient·u = −decrease, by operator splitting.

    Args:
        n: number of joints.
        tolerance: absolute and relative tolerance of OSQP; its own default is 1e-3.

    Attributes:
        iterations: of the last solve.
    """

    def __init__(self, n: int, tolerance: float = 1e-5) -> None:
        import osqp  # noqa: PLC0415 - only where somebody asks for this solver
        from scipy import sparse  # noqa: PLC0415 - comes with osqp

        self.n, self.iterations = n, 0
        self._rows = np.ones(2 * n)
        self._places = 2 * np.arange(n)  # column by column: the equation's entry, the bound's
        constraints = sparse.vstack([sparse.csc_matrix(np.ones((1, n))), sparse.eye(n)], "csc")
        self._lower = np.zeros(n + 1)
        self._upper = np.full(n + 1, np.inf)
        self._upper[0] = self._lower[0] = 1.0
        self._linear = np.zeros(n)
        self._quadratic = np.ones(n)
        self._model: Any = osqp.OSQP()
        self._model.setup(
            P=sparse.eye(n, format="csc"),
            q=self._linear,
            A=constraints,
            l=self._lower,
            u=self._upper,
            verbose=False,
            eps_abs=tolerance,
            eps_rel=tolerance,
            polishing=True,
            scaling=0,
            warm_starting=True,
        )
        self._solved = osqp.SolverStatus.OSQP_SOLVED
        self._gamma = 0.0

    def solve(
        self,
        gradient: NDArray[np.float64],
        decrease: float,
        gamma: float,
        out: NDArray[np.float64],
    ) -> None:
        """Write u, (n,), into `out`.

        Raises:
            InfeasibleError: the gradient is zero and the decrease is not.
            BadProblemError: something is not finite, γ is not in [0, 1], or OSQP gave up.
        """
        top = float(np.max(np.abs(gradient)))
        if not (np.isfinite(top) and np.isfinite(decrease) and 0.0 <= gamma <= 1.0):
            raise BadProblemError("OSQP: gradient, decrease and gamma in [0, 1] must be finite")
        if decrease == 0.0:
            out[:] = 0.0
            return
        if top == 0.0:
            raise InfeasibleError("OSQP: no input changes V: the gradient is zero")
        scale = abs(decrease) / top  # x is solved for in this unit, so the equation reads aᵀx = 1
        self._rows[self._places] = np.abs(gradient) / top
        self._linear[:] = gamma
        self._quadratic[:] = (1.0 - gamma) * scale
        self._model.update(q=self._linear, Ax=self._rows, Px=self._quadratic)
        result = self._model.solve(raise_error=False)
        self.iterations = int(result.info.iter)
        if result.info.status_val != self._solved:
            raise BadProblemError(f"OSQP: {result.info.status}")
        np.multiply(np.sign(gradient), result.x, out=out)
        out *= -scale if decrease > 0.0 else scale
