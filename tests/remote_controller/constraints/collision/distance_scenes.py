"""Obstacles for tests of distances, and the entry of a config."""

from __future__ import annotations

BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
POLE = {
    "name": "pole",
    "shape": "capsule",
    "ends_m": [[0.2, -0.3, 0.0], [0.25, 0.3, 0.5]],
    "radius_m": 0.02,
}
TABLE = {
    "name": "table",
    "shape": "box",
    "center_m": [0.4, 0.1, 0.2],
    "size_m": [0.3, 0.5, 0.1],
    "rpy_rad": [0.1, -0.2, 0.4],
}
WORLD = [BALL, POLE, TABLE]
POLE_BESIDE = {
    "name": "pole",
    "shape": "capsule",
    "ends_m": [[0.15, 0.0, 0.1], [0.15, 0.0, 0.9]],
    "radius_m": 0.03,
}


def distance(**settings_given: object) -> dict[str, object]:
    return {"constraint": "distance", **settings_given}
