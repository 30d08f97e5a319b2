"""Attacks on a robot, on loopback and between two networks."""
