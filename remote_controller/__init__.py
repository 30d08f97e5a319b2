"""Answers each sample of a robot with a setpoint, before the next tick."""
