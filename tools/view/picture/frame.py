"""A State and the Setpoint that answers it, as one frame of the page; live and from a log alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.tools.picture.poses import Poses
from hoap3.tools.view.picture.config_scene import ConfigScene
from hoap3.tools.view.picture.contacts import Contacts
from hoap3.tools.view.picture.geometry import Looks
from hoap3.tools.view.picture.targets import all_present

MODES = ("idle", "active", "stopping", "stopped")
NONE = Setpoint.schema.constants["STATUS_NONE"]
MOST_EXTRA = 16  # columns of the controller's own that are plotted
Plot = dict[str, Any]

PLOTS: tuple[tuple[str, str, str, str], ...] = (
    ("error", "task error √(2V)", "", "error"),
    ("position_share", "joint nearest to a position limit", "%", "position"),
    ("speed_share", "fastest joint, of its limit", "%", "speed"),
    ("effort_share", "largest effort, of its limit", "%", "effort"),
    ("answer_us", "State to answer", "µs", "rtt"),
    ("cycle_us", "controller's cycle", "µs", "rtt"),
    ("misses", "late and lost", "", "misses"),
    ("skipped", "skipped", "", "misses"),
    ("success_rate", "in time, of the last 100", "", "success"),
    ("v", "Lyapunov function V", "", "V"),
    ("v_rate_required", "dV/dt at most", "V/s", "V rate"),
    ("v_rate_predicted", "dV/dt of the command", "V/s", "V rate"),
    ("rho", "share ρ of the required decrease", "", "rho"),
    ("active_joints", "active joints", "", "active"),
    ("margin", "smallest margin of the constraints", "", "margin"),
)
"""Key, label, unit and group of what is plotted; those of a group share axes."""

CERTIFICATE = {"V", "V rate", "rho", "active", "margin"}
"""Groups that the page shows in a section of their own, folded at first."""


class Frames:
    """Makes frames of one robot, and what a page must know before the first.

    Args:
        description: of the robot.
        looks: its shapes.
        about: what the controller tells of itself, as `control/about` has it; may be empty.
        emulator: the robot's configuration, or None.

    Attributes:
        description, looks: see above.
        targets: live targets of the controller.
        poses: of the State that the newest frame shows.
    """

    def __init__(
        self,
        description: RobotDescription,
        looks: Looks,
        about: Mapping[str, Any] | None = None,
        emulator: object = None,
    ) -> None:
        self.description, self.looks = description, looks
        self.poses = Poses(description)
        self._about, self._emulator = about or {}, emulator
        scene = ConfigScene(description, self._about.get("config"))
        self.targets = scene.steered(self._about.get("targets"))
        self._shapes = scene.constraints()
        self._tasks = scene.task_frames()
        self._contacts = Contacts(description, emulator, scene.standing_soles())
        extra = self._about.get("extra")
        names = [str(each)[:64] for each in extra] if isinstance(extra, list) else []
        self._extra = names[:MOST_EXTRA]

    @property
    def extras(self) -> int:
        """How many of the controller's own columns are plotted."""
        return len(self._extra)

    def hello(self) -> dict[str, Any]:
        """What stays: shapes, joints, soles, targets, constraints, plots, configurations."""
        robot = self.description
        kinds = robot.structure.movable
        return {
            "robot": robot.name,
            "period_s": robot.period_s,
            "links": [
                {"name": link, "visuals": self.looks.visuals.get(link, [])}
                for link in self.poses.links
            ],
            "joints": [
                {
                    "name": joint.name,
                    "lower": _number(joint.lower),
                    "upper": _number(joint.upper),
                    "velocity": joint.velocity,
                    "effort": _number(joint.effort),
                    "unit": "m" if kinds[joint.name].kind == "prismatic" else "rad",
                }
                for joint in robot.joints
            ],
            "stands": bool(robot.soles) or robot.state_lengths.get("base", 0) > 0,
            "soles": [
                {"link": sole.frame, "polygon": [[x, y, 0.0] for x, y in sole.polygon]}
                for sole in robot.soles
            ],
            "targets": [target.as_json() for target in self.targets],
            "constraints": self._shapes,
            "plots": self.plots(),
            "config": self._config(),
            "notes": list(self.looks.notes),
        }

    def plots(self) -> list[Plot]:
        """What is plotted."""
        found = [
            {
                "key": key,
                "label": label,
                "unit": unit,
                "group": group,
                "log": group == "V",
                "certificate": group in CERTIFICATE,
            }
            for key, label, unit, group in PLOTS
            if group != "effort" or has_efforts(self.description)
        ]
        found += [
            {"key": f"extra.{i}", "label": name, "unit": "", "group": name, "log": False}
            for i, name in enumerate(self._extra)
        ]
        return found

    def fits(self, state: State) -> bool:
        """Whether a State is of this robot, by the lengths of its arrays, and says where it is."""
        expected = self.description.state_lengths
        if any(length != expected.get(name, 0) for name, length in state.lengths.items()):
            return False
        return finite(state.q, state.base)

    def frame(self, state: State, setpoint: Setpoint | None) -> dict[str, Any]:
        """One frame; `setpoint` answers the State, None where nobody knows."""
        poses = self.poses
        poses.update(state.q, state.base)
        com = poses.com
        return {
            "kind": "frame",
            "tick": state.tick,
            "time_s": round(state.tick * self.description.period_s, 6),
            "stamp_ns": state.stamp_published,
            "mode": MODES[state.mode] if state.mode < len(MODES) else "idle",
            "poses": rounded(poses.poses),
            "q": np.round(state.q, 6).tolist(),
            "dq": [_number(each) for each in np.round(state.dq, 6).tolist()],
            "tau": [_number(each) for each in np.round(state.tau, 4).tolist()],
            "com": None if com is None else np.round(com, 6).tolist(),
            **self._contacts.look(state, poses),
            "frames": [{"name": name, "pose": self._pose(link)} for name, link in self._tasks],
            "targets": [
                None if each is None else np.round(each, 6).tolist()
                for each in all_present(self.targets, poses, state.q)
            ],
            "values": self.values(state, setpoint),
        }

    def values(self, state: State, setpoint: Setpoint | None) -> dict[str, float | None]:
        """What is plotted, by key; None for what is not known."""
        used = shares_of_limits(self.description, state.q, state.dq, state.tau)
        found: dict[str, float | None] = {
            **{key: _number(float(share)) for key, share in used.items()},
            "misses": float(state.late + state.lost),
            "skipped": float(state.skipped),
            "success_rate": _number(state.success_rate),
        }
        if setpoint is not None:
            found |= self._answer(setpoint)
        return found

    def _answer(self, setpoint: Setpoint) -> dict[str, float | None]:
        cycle = (setpoint.stamp_encoded - setpoint.stamp_received) / 1e3
        found: dict[str, float | None] = {"cycle_us": round(cycle, 1)}
        if setpoint.solver_status != NONE:
            for key in ("v", "v_rate_required", "v_rate_predicted", "rho", "margin"):
                found[key] = _number(getattr(setpoint, key))
            found["active_joints"] = float(setpoint.active_joints)
            v = found["v"]
            found["error"] = math.sqrt(2.0 * v) if v is not None and v >= 0.0 else None
        for i, value in enumerate(setpoint.extra[: len(self._extra)].tolist()):
            found[f"extra.{i}"] = _number(value)
        return found

    def _pose(self, link: str) -> list[float]:
        if link == COM:
            com = self.poses.com
            place = [0.0, 0.0, 0.0] if com is None else np.round(com, 6).tolist()
            return [*place, 0.0, 0.0, 0.0, 1.0]
        return rounded([self.poses.pose(link)])[0]

    def _config(self) -> str:
        """The configurations of both sides, as YAML."""
        sides = {"controller": self._about.get("config"), "robot": self._emulator}
        told = {side: config for side, config in sides.items() if config}
        return yaml.safe_dump(told, sort_keys=False, allow_unicode=True) if told else ""


def shares_of_limits(
    robot: RobotDescription, q: FloatArray, dq: FloatArray, tau: FloatArray
) -> dict[str, FloatArray]:
    """How much of its limits the joint nearest to one uses [%].

    Args:
        robot: whose limits count.
        q, dq, tau: (..., n) positions, velocities and efforts.

    Returns:
        by key of `PLOTS`, (...): of positions 0 in the middle of the range and 100 at a limit.
        Joints without a limit do not count.
    """
    half = (robot.upper - robot.lower) / 2.0
    limited = np.isfinite(half) & (half > 0.0)
    middle = (robot.upper[limited] + robot.lower[limited]) / 2.0
    shares = {
        "position_share": np.abs(q[..., limited] - middle) / half[limited],
        "speed_share": np.abs(dq) / robot.velocity,
    }
    if has_efforts(robot):
        shares["effort_share"] = np.abs(tau) / robot.effort
    return {key: 100.0 * each.max(axis=-1, initial=0.0) for key, each in shares.items()}


def has_efforts(robot: RobotDescription) -> bool:
    """Whether the effort limit of any joint is known."""
    return bool(np.isfinite(robot.effort).any())


def finite(*arrays: FloatArray) -> bool:
    """Whether all of them are numbers that can be drawn."""
    return all(bool(np.isfinite(each).all()) for each in arrays)


def rounded(poses: list[list[float]]) -> list[list[float]]:
    """To a micrometre, and a millionth of a quaternion."""
    found: list[list[float]] = np.round(np.array(poses, float), 6).tolist()
    return found


def _number(value: float) -> float | None:
    """As JSON has it: None where it is not finite."""
    return value if math.isfinite(value) else None
