"""Numerical solvers: arrays in, arrays out, no robot in them.

Importing this package compiles nothing; making a solver or calling one does.
"""

from __future__ import annotations

from remote_controller.solvers.pinv import Pinv, pinv, pinv_plain
from remote_controller.solvers.qp12 import Qp12, qp12

__all__ = ["Pinv", "Qp12", "pinv", "pinv_plain", "qp12"]
