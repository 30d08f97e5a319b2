"""Priorities and weights of tasks, and how they change over time."""
