"""Bounds of joint accelerations that keep position and velocity limits, and what torques leave.

See `protocol.limits` and `protocol.torque_limits`.
"""

from __future__ import annotations

from protocol.limits import (
    AccelerationBounds,
    acceleration_bounds,
    naive_acceleration_bounds,
)
from protocol.torque_limits import TorqueAccelerationBounds, torque_acceleration_bounds

__all__ = [
    "AccelerationBounds",
    "TorqueAccelerationBounds",
    "acceleration_bounds",
    "naive_acceleration_bounds",
    "torque_acceleration_bounds",
]
