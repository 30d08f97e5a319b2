"""Closed-loop inverse kinematics of prioritised tasks with gains that stay as they are.

Marti-Saumell et al., (7): dq = B Λ e, B = [J_1⁺ | N_1 J_2⁺ | …]; see `clik_kernels`. It is what
`SdpGains` is measured by, with the same attributes and the same proof: for constant targets and by
the linear model, V = ½ Σ w_i e_i² falls by V⁺ ≤ (1 − β Δt) V, β = λ_min(−A − Aᵀ − Δt AᵀA), and a β
that is not positive proves nothing. Where dq would leave its limits, all gains are shortened alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, array, check_sizes

Array = NDArray[np.float64]

NAME = "constant gains"


class ConstantGains:
    """Joint speeds for a stack of tasks and n joints, without allocating anything.

    Args:
        sizes: number of rows of each task, the most important first.
        joints: number of joints.
        wanted: λ [1/s], one for each row.

    Attributes:
        weights: w of V, (n,), positive, to be written to; 1 at first.
        damping: d ≥ 0, to be set; 0 at first: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺.
        lower, upper: limits of dq, (joints,), to be written to; ∓inf at first. They hold
            lower ≤ 0 ≤ upper.
        rates: of the targets, (n,), to be written to; 0 at first: as of `SdpGains`.
        fed, fed_share: what they take of dq, (joints,) [rad/s], and how much of it: likewise.
        gains: λ as they were applied, (n,) [1/s].
        dq: joint speeds, (joints,) [rad/s].
        beta: β [1/s] that the gains certify; not positive, if they certify nothing.
        status: index into `status.NAMES`: `OK`, `OUT_OF_RANGE`, `BAD_INPUT`, `BAD_SHAPE`.
        task_rank: of the stacked Jacobian.

    Raises:
        BadProblemError: no task, one without rows, or no joint; gains that are no numbers.
    """

    def __init__(self, sizes: Sequence[int], joints: int, wanted: ArrayLike) -> None:
        from hoap3.remote_controller.solvers.clik import constant_gains_kernels

        check_sizes(NAME, sizes, joints)
        n = self.n = sum(sizes)
        self.wanted, self.weights, self.damping = array("wanted", wanted, 1).copy(), np.ones(n), 0.0
        self.offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._kernel = constant_gains_kernels.constant_gains_kernel
        self._limits = np.array([[-math.inf], [math.inf], [0.0]]).repeat(joints, axis=1)
        self.lower, self.upper, self.fed = self._limits
        self.rates, self.gains, self.dq = np.zeros(n), np.zeros(n), np.zeros(joints)
        self._work = (
            np.zeros((8, n, n)),
            np.zeros((2, n, joints)),
            np.zeros((n, 2 * n)),
            np.zeros((4, max(n, joints))),
        )
        self.status, self.task_rank, self.beta, self.fed_share = codes.UNSOLVED, 0, 0.0, 1.0

    def solve(self, jacobian: Array, errors: Array, dt: float) -> int:
        """Find dq and β; see the attributes.

        Args:
            jacobian: the tasks' rows, (n, joints). Dependent and zero rows do no harm.
            errors: σ* − σ, (n,).
            dt: Δt [s].

        Returns:
            The status.

        Raises:
            BadProblemError: wrong type of array.
        """
        try:
            self.status, self.task_rank, self.beta, self.fed_share = self._kernel(
                jacobian,
                errors,
                self.rates,
                self.offsets,
                self.weights,
                self._limits,
                dt,
                self.damping,
                self.wanted,
                *self._work,
                self.gains,
                self.dq,
            )
        except TypeError as error:
            raise BadProblemError(f"{NAME}: wrong type of argument. {KERNEL_ARRAYS}") from error
        return self.status
