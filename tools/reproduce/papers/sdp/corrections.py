"""Where the paper is wrong in a way that a figure shows."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.clik_reference import (
    certified,
    null_space_projector,
    prioritised,
)
from hoap3.remote_controller.solvers.sdp.sdp_backends import clarabel, conic, installed
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA, SdpGains
from hoap3.remote_controller.solvers.sdp.sdp_reference import optimum
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.sdp import oracle
from hoap3.tools.reproduce.papers.sdp import reference as ref
from hoap3.tools.reproduce.papers.sdp.arm import JOINTS, SIZES, START, toolbox
from hoap3.tools.reproduce.papers.sdp.loop import AT_LIMIT, scheduled
from hoap3.tools.reproduce.papers.sdp.runs import Runs
from hoap3.tools.reproduce.papers.sdp.table import same
from hoap3.tools.reproduce.rows import Row, bounded, measured, near

UNSTABLE: tuple[tuple[int, int], Array] = (
    (1, 2),
    np.array([[-2.0, 1.0, 1.0, -3.0], [1.0, 0.0, 3.0, -1.0], [-1.0, 1.0, 3.0, -3.0]]),
)
"""Independent tasks, and sizes, for which no diagonal gains lower V."""

LONG_DT_S = 0.1
TINY = 1e-6  # of δ


def rows(runs: Runs) -> list[Row]:
    """All of them."""
    return [*_no_gains(), *_too_fast(), *_transposed(), *_regularised(runs), _weighted()]


def _no_gains() -> list[Row]:
    """Section III: independent tasks are said to have suitable gains."""
    sizes, J = UNSTABLE
    solver = SdpGains(sizes, J.shape[1])
    found = solver.solve(J, np.ones(len(J)), ref.DT_S, ref.FAST)
    named = found == status.STATIONARY and not solver.gains.any() and not solver.dq.any()
    return [
        near("section III: rank of the tasks of a counterexample", None, solver.task_rank, len(J),
             _COUNTEREXAMPLE, absolute=0.0),
        near("section III: its β", None, solver.beta, 0.0, _COUNTEREXAMPLE, unit="1/s",
             absolute=0.0),
        bounded("section III: it is named, and the robot keeps still", None, float(named),
                (1.0, 1.0), _COUNTEREXAMPLE),
    ]  # fmt: skip


def _too_fast() -> list[Row]:
    """(20) needs β ≤ 1/Δt."""
    J, errors = toolbox()(START)
    hand = SIZES[0]
    solver = SdpGains((hand,), JOINTS)
    solver.solve(J[:hand].copy(), errors[:hand].copy(), LONG_DT_S, 2.0 / LONG_DT_S)
    most = 1.0 / LONG_DT_S
    item = "(20): hand alone, β̃ = 2/Δt, Δt = 0.1 s, without limits"
    return [
        near(f"{item}, β", None, solver.beta, most, _TOO_FAST, unit="1/s"),
        near(f"{item}, mean λ", None, float(solver.gains.mean()), most, _TOO_FAST, unit="1/s"),
    ]


def _transposed() -> list[Row]:
    """(22) as printed, where Clarabel is installed: ours has the pseudoinverse throughout."""
    if "clarabel" not in installed():
        return []
    J, errors = toolbox()(START)
    J1, J2 = J[:3], J[3:]
    B, L = prioritised(SIZES, J, np.ones(len(J)))
    printed_B = np.hstack([J1.T, null_space_projector(J1) @ J2.T])
    limit = np.full(JOINTS, ref.LIMIT_RAD_S / ref.FAST)
    P, q, A, b, used, size = conic(
        J @ printed_B, (B * errors).T, np.stack([-limit, limit]), ref.DT_S * ref.FAST, DELTA
    )
    x = ref.FAST * clarabel(P, q, A, b, used.size, size)[0]
    actual = certified(L, x[:-1], ref.DT_S)
    known = J @ printed_B, B * errors, -limit, limit, ref.DT_S * ref.FAST, DELTA
    expected = ref.FAST * optimum(*known)[1]
    return [
        near("(22): β(0), β̃ = 8, with Jᵀ as printed", None, float(x[-1]), expected,
             f"{_TRANSPOSED}. Next to it the oracle's optimum", unit="1/s"),
        measured("(22): β that these gains have by (14)", None, actual, _TRANSPOSED,
                 unit="1/s"),
    ]  # fmt: skip


def _regularised(runs: Runs) -> list[Row]:
    """δ of (27) lowers β where no limit does."""
    margin = ref.LIMIT_RAD_S - float(np.abs(runs.slow.dq[0]).max())
    return [
        same(f"(27): β(0), β̃ = {ref.SLOW:g}, δ = 5·10⁻⁵", float(runs.slow.beta[0]),
             float(oracle.scheduled(ref.SLOW, seconds=0.0).beta[0]), _DELTA, "1/s"),
        bounded("(27): least distance from a limit there", None, margin, (AT_LIMIT, None), _DELTA,
                unit="rad/s"),
        near(f"(27): β(0), β̃ = {ref.SLOW:g}, δ a millionth of that", None,
             _beta(ref.SLOW, TINY * DELTA), ref.SLOW, _DELTA, unit="1/s", absolute=1e-3),
    ]  # fmt: skip


def _beta(desired: float, delta: float) -> float:
    """β at the start."""
    J, errors = toolbox()(START)
    solver = SdpGains(SIZES, JOINTS)
    solver.lower[:], solver.upper[:] = -ref.LIMIT_RAD_S, ref.LIMIT_RAD_S
    solver.solve(J, errors, ref.DT_S, desired, delta)
    return solver.beta


def _weighted() -> Row:
    """(9) adds squares of anything."""
    weights = (1.0, 1.0, 1.0, ref.WRIST_WEIGHT)
    run = scheduled(ref.FAST, seconds=1.0, weights=weights)
    expected = oracle.scheduled(ref.FAST, seconds=1.0, weights=weights)
    item = f"(9): β(1 s), β̃ = {ref.FAST:g}, w₂ = {ref.WRIST_WEIGHT:g}"
    return same(item, float(run.beta[-1]), float(expected.beta[-1]), _WEIGHTS, "1/s")


_COUNTEREXAMPLE = (
    "The paper, after [11], says that independent tasks have suitable gains. With two rows or more "
    "below another task that is not so for diagonal ones: these three rows are independent"
)
_TOO_FAST = (
    "Not in the paper: V cannot fall by more than all of itself in a step, β ≤ 1/Δt. What is asked "
    "beyond that is met by λ = 1/Δt, but for δ"
)
_TRANSPOSED = (
    "(22) has Jᵀ, (14) and the authors' code J†, and J† is meant: with Jᵀ the matrix inequality is "
    "about another law than the one that moves the robot, which has 6.74. Found by Clarabel"
)
_DELTA = (
    "The paper relaxes β where limits ask for it, and has δ for solvability only; but δ|λ|² alone "
    "lowers β, by a lot where tasks are nearly dependent"
)
_WEIGHTS = (
    "V of the paper adds squares without weights. They cost nothing, L becomes D L D⁻¹, and a "
    "smaller one of the lower task raises β, 3.5 without"
)
