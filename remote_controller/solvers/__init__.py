"""Numerical solvers: arrays in, arrays out, no robot in them.

Importing this package compiles nothing; making a solver or calling one does.
"""

from __future__ import annotations

from remote_controller.solvers.bounded_qp12 import BoundedQp12, qp12_bounded
from remote_controller.solvers.descent_rate import DescentRate
from remote_controller.solvers.ghc import Ghc, ghc
from remote_controller.solvers.lp_norm import LpNorm, lp_norm
from remote_controller.solvers.lyapunov import feasible_rate, lyapunov_qp
from remote_controller.solvers.pinv import Pinv, pinv, pinv_plain
from remote_controller.solvers.projector import generalized_projector
from remote_controller.solvers.qp12 import Qp12, qp12
from remote_controller.solvers.stable_qp import StableQp

__all__ = [
    "BoundedQp12",
    "DescentRate",
    "Ghc",
    "LpNorm",
    "Pinv",
    "Qp12",
    "StableQp",
    "feasible_rate",
    "generalized_projector",
    "ghc",
    "lp_norm",
    "lyapunov_qp",
    "pinv",
    "pinv_plain",
    "qp12",
    "qp12_bounded",
]
