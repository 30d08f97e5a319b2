"""Bounds of joint accelerations that keep position and velocity limits, and what torques leave.

See `hoap3.protocol.limits.viability_bounds` and `hoap3.protocol.limits.torque_bounds`.
"""

from __future__ import annotations

from hoap3.protocol.limits.torque_bounds import TorqueAccelerationBounds, torque_acceleration_bounds
from hoap3.protocol.limits.viability_bounds import AccelerationBounds, acceleration_bounds

__all__ = [
    "AccelerationBounds",
    "TorqueAccelerationBounds",
    "acceleration_bounds",
    "torque_acceleration_bounds",
]
