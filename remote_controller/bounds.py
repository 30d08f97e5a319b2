"""Bounds of joint accelerations that keep position and velocity limits; see `protocol.limits`."""

from __future__ import annotations

from protocol.limits import AccelerationBounds, acceleration_bounds

__all__ = ["AccelerationBounds", "acceleration_bounds"]
