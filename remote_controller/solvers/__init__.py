"""Numerical solvers: arrays in, arrays out, no robot in them.

Importing this package compiles nothing; making a solver or calling one does.
"""

from __future__ import annotations

from hoap3.remote_controller.solvers.ghc.ghc import Ghc, ghc
from hoap3.remote_controller.solvers.ghc.hqp import hqp
from hoap3.remote_controller.solvers.ghc.projector import generalized_projector
from hoap3.remote_controller.solvers.ghc.weighted import weighted
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import DescentRate
from hoap3.remote_controller.solvers.lyapunov_qp.functions import feasible_rate, lyapunov_qp
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm, lp_norm
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp
from hoap3.remote_controller.solvers.qp12.bounded_qp12 import BoundedQp12, qp12_bounded
from hoap3.remote_controller.solvers.qp12.pinv import Pinv, pinv, pinv_plain
from hoap3.remote_controller.solvers.qp12.qp12 import Qp12, qp12
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains, sdp_gains

__all__ = [
    "BoundedQp12",
    "DescentRate",
    "Ghc",
    "LpNorm",
    "Pinv",
    "Qp12",
    "SdpGains",
    "StableQp",
    "feasible_rate",
    "generalized_projector",
    "ghc",
    "hqp",
    "lp_norm",
    "lyapunov_qp",
    "pinv",
    "pinv_plain",
    "qp12",
    "qp12_bounded",
    "sdp_gains",
    "weighted",
]
