"""Numerical solvers: arrays in, arrays out, no robot in them.

Importing this package compiles nothing; making a solver or calling one does.
"""

from __future__ import annotations

from hoap3.remote_controller.solvers.bounded_qp12 import BoundedQp12, qp12_bounded
from hoap3.remote_controller.solvers.descent_rate import DescentRate
from hoap3.remote_controller.solvers.ghc import Ghc, ghc
from hoap3.remote_controller.solvers.hqp import hqp
from hoap3.remote_controller.solvers.lp_norm import LpNorm, lp_norm
from hoap3.remote_controller.solvers.lqp import PlainLqp, lqp
from hoap3.remote_controller.solvers.lyapunov import feasible_rate, lyapunov_qp
from hoap3.remote_controller.solvers.pinv import Pinv, pinv, pinv_plain
from hoap3.remote_controller.solvers.projector import generalized_projector, projected_sum
from hoap3.remote_controller.solvers.qp12 import Qp12, qp12
from hoap3.remote_controller.solvers.sdp_gains import SdpGains, sdp_gains
from hoap3.remote_controller.solvers.stable_qp import StableQp
from hoap3.remote_controller.solvers.weighted import weighted

__all__ = [
    "BoundedQp12",
    "DescentRate",
    "Ghc",
    "LpNorm",
    "Pinv",
    "PlainLqp",
    "Qp12",
    "SdpGains",
    "StableQp",
    "feasible_rate",
    "generalized_projector",
    "ghc",
    "hqp",
    "lp_norm",
    "lqp",
    "lyapunov_qp",
    "pinv",
    "pinv_plain",
    "projected_sum",
    "qp12",
    "qp12_bounded",
    "sdp_gains",
    "weighted",
]
