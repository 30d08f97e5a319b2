"""Misses that a load next to a robot adds: `python -m benchmarks.load clients|view|flood`.

`runs` does pairs of runs with and without it; `clients`, `page` and `flood` are the loads.
"""
