"""Limits of single joints: range, speed, acceleration, torque."""
