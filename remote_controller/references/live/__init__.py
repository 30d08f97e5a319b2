"""Targets that somebody steers while the robot moves."""
