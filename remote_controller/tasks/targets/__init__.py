"""Targets: where a task shall be at time t, and how fast that moves."""
