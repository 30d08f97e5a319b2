"""A ball between a hand and its target, and a wall before it, on an arm and on a humanoid."""

from __future__ import annotations

from typing import Any

from hierarchy_runs import content

RANKED = ("ghc", "hqp", "weighted")
LINKS = {"lwr": ["link_6", "link_7"], "humanoid32": ["l_hand", "l_forearm"]}
BALLS = {"lwr": ([0.18, -0.47, 0.5], 0.08), "humanoid32": ([0.42, 0.27, 0.42], 0.05)}
WALLS = {"lwr": ("ee", -0.49), "humanoid32": ("r_palm", -0.34)}  # both y ≥ that
BEHIND = {"kind": "point", "position_m": [0.40, 0.25, 0.62], "approach_s": 1.0}


def kept(robot: str) -> list[dict[str, Any]]:
    """The ball and the wall, as constraints."""
    (center, radius), (frame, offset) = BALLS[robot], WALLS[robot]
    ball = {"shape": "sphere", "name": "round", "center_m": center, "radius_m": radius}
    near = {"pairs": [], "obstacles": [ball], "obstacle_links": LINKS[robot], "rows": 40}
    plane = {"frame": frame, "normal": [0, 1, 0], "offset_m": offset}
    return [
        {"constraint": "distance", "name": "ball", "parameters": near},
        {"constraint": "half_space", "name": "wall", "parameters": plane},
    ]


def avoiding(robot: str, name: str) -> dict[str, Any]:
    """The shipped tasks of a robot, strictly ranked or by weights, with a ball and a wall."""
    tasks = content("ghc" if robot == "lwr" else "ghc_humanoid")["parameters"]["tasks"]
    names = [task["name"] for task in tasks]
    if robot == "humanoid32":
        tasks[names.index("left_hand")]["parameters"]["target"] = BEHIND
    order: list[Any] = names if robot == "lwr" else [names[0], names[1:3], *names[3:]]
    priorities: dict[str, Any] = {"order": order}
    if name == "weighted":
        priorities = {"weights": {each: 10.0**-place for place, each in enumerate(names)}}
    parameters = {"tasks": tasks, "priorities": priorities, "constraints": kept(robot)}
    return {"controller": name, "robot": robot, "parameters": parameters}
