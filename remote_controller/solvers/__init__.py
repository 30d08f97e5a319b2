"""Numerical solvers: arrays in, arrays out, no robot in them.

Importing this package compiles nothing; making a solver or calling one does.
"""

from __future__ import annotations

from hoap3.remote_controller.solvers.ghc.ghc import Ghc
from hoap3.remote_controller.solvers.ghc.hqp import hqp
from hoap3.remote_controller.solvers.ghc.weighted import weighted
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp
from hoap3.remote_controller.solvers.qp12.pinv import Pinv
from hoap3.remote_controller.solvers.qp12.qp12 import Qp12
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains

__all__ = [
    "Ghc",
    "Pinv",
    "Qp12",
    "SdpGains",
    "StableQp",
    "hqp",
    "weighted",
]
