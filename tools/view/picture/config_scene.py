"""What of a controller's config can be drawn: frames of tasks, live targets, constraints.

The config came over the network or out of a log. It is read as data: no name in it is imported, no
file is opened, and what does not fit the robot is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeGuard

import numpy as np

from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.constraints.collision.collision_geometry import axes_along, rotation
from hoap3.tools.view.picture.geometry import Shape, pose

MOST = 64  # tasks, constraints, or obstacles of one
DEEPEST = 8  # levels of a config that are looked through
FAR = 1e6  # of a number that is drawn [m]
PLANE_M = 0.5  # half the side of the piece of a plane that is drawn
FORBIDDEN = (0.84, 0.37, 0.0, 0.35)  # vermilion, told from the rest by the colour-blind, too
STEERED = {
    "com": "com",
    "frame_position": "frame_position",
    "frame_orientation": "frame_orientation",
    "frame_pose": "frame_pose",
    "posture": "posture",
    "wrench": "frame_position",
}
"""What a target of each task is."""


@dataclass(frozen=True)
class Steered:
    """A live target, and what of the robot it moves.

    Attributes:
        name: by which senders call it.
        kind: `frame_position`, `frame_pose`, `frame_orientation`, `com`, `posture`, `wrench`, or
            `unknown`.
        frame: the link that it moves; None of a posture and of the centre of mass.
        reference: the link in whose axes its numbers are; None where they are none.
        joints: of a posture, places in wire order.
        told: what the controller says of it: dimension, rates, layout, unit, bounds.
    """

    name: str
    kind: str
    frame: str | None
    reference: str | None
    joints: tuple[int, ...]
    told: Mapping[str, Any]

    @property
    def dimension(self) -> int:
        """Numbers of a point."""
        return int(self.told["dimension"])

    @property
    def rates(self) -> int:
        """Numbers of its rate."""
        return int(self.told["rates"])

    def as_json(self) -> dict[str, Any]:
        """As the page has it."""
        keys = ("dimension", "rates", "layout", "unit", "speed", "acceleration", "jerk")
        told = {key: self.told.get(key) for key in keys}
        return {
            "name": self.name,
            "kind": self.kind,
            "frame": self.frame,
            "reference": self.reference,
            "joints": list(self.joints),
            **told,
        }


class ConfigScene:
    """What a config says of a robot's links.

    Args:
        description: of the robot.
        config: of its controller, or None where nobody tells.
    """

    def __init__(self, description: RobotDescription, config: object) -> None:
        self._robot = description
        found = config.get("parameters") if isinstance(config, Mapping) else None
        self._parameters: Mapping[str, Any] = found if isinstance(found, Mapping) else {}
        self._tasks = list(islice(_named("task", self._parameters), MOST))
        self._constraints = list(islice(_named("constraint", self._parameters), MOST))

    def task_frames(self) -> list[tuple[str, str]]:
        """Label and link of each task that moves one; COM for the centre of mass."""
        found = []
        for task in self._tasks:
            link = COM if task["task"] == "com" else self._link(_below(task), "frame")
            if link is not None:
                found.append((str(task.get("name") or task["task"])[:64], link))
        if not found:
            point = self._parameters.get("point", self._parameters.get("tip"))
            default = self._robot.default_task
            if point in self._robot.frames:
                found.append((str(point), str(point)))
            elif default is not None:
                found.append((default.point, default.point))
        return list(dict.fromkeys(found))

    def steered(self, targets: object) -> list[Steered]:
        """The live targets, in the order in which messages count them.

        Args:
            targets: as the controller tells them.
        """
        told = targets if isinstance(targets, list) else []
        return [self._steered(each) for each in told if _is_target(each)]

    def constraints(self) -> list[Shape]:
        """Obstacles and planes, each a shape in the axes of its `link`."""
        found: list[Shape] = []
        for each in self._constraints:
            parameters, kind = _below(each), each["constraint"]
            if kind == "half_space":
                found += self._plane(parameters)
            given = parameters.get("obstacles")
            if isinstance(given, list):
                for obstacle in given[:MOST]:
                    found += self._obstacle(obstacle)
        return found

    def standing_soles(self) -> tuple[str, ...]:
        """Soles that a constraint on balance counts on, and that of the base frame."""
        known = {sole.frame for sole in self._robot.soles}
        named = {self._robot.base_frame}
        for each in self._constraints:
            soles = _below(each).get("soles")
            if isinstance(soles, list):
                named |= {sole for sole in soles if isinstance(sole, str)}
        return tuple(sorted(known & named))

    def _steered(self, told: Mapping[str, Any]) -> Steered:
        name = str(told["name"])
        for task in self._tasks:
            parameters = _below(task)
            for key in ("target", "wrench_target"):
                target = parameters.get(key)
                if not isinstance(target, Mapping) or target.get("kind") != "live":
                    continue
                if target.get("name", "target") == name:
                    kind = STEERED.get(str(task["task"]), "unknown")
                    return self._of(name, "wrench" if key != "target" else kind, parameters, told)
        return Steered(name, "unknown", None, None, (), told)

    def _of(
        self, name: str, kind: str, parameters: Mapping[str, Any], told: Mapping[str, Any]
    ) -> Steered:
        robot = self._robot
        if kind == "posture":
            places = {joint: place for place, joint in enumerate(robot.joint_names)}
            layout = told.get("layout")
            joints = [places.get(each, -1) for each in (layout if isinstance(layout, list) else [])]
            whole = len(joints) == told["dimension"] and -1 not in joints
            return Steered(name, kind if whole else "unknown", None, None, tuple(joints), told)
        if kind == "com":
            whence = self._link(parameters, "frame", "r_sole")
            return Steered(name, kind if whence else "unknown", None, whence, (), told)
        frame = self._link(parameters, "frame")
        if parameters.get("reference") is None:
            seen: str | None = robot.base_frame
        else:
            seen = self._link(parameters, "reference")
        fits = {"frame_position": 3, "frame_orientation": 4, "frame_pose": 7}
        if kind == "frame_pose" and told["dimension"] == 3:
            kind = "frame_position"
        if frame is None or seen is None or fits.get(kind, told["dimension"]) != told["dimension"]:
            kind = "unknown"
        return Steered(name, kind, frame, seen, (), told)

    def _link(self, parameters: Mapping[str, Any], key: str, default: str = "") -> str | None:
        """A link that is named, if the robot has it."""
        name = parameters.get(key, default)
        return name if isinstance(name, str) and name in self._robot.frames else None

    def _plane(self, parameters: Mapping[str, Any]) -> list[Shape]:
        normal, offset = _triple(parameters.get("normal")), parameters.get("offset_m", 0.0)
        link = self._robot.base_frame
        if parameters.get("reference") is not None:
            link = self._link(parameters, "reference") or ""
        if normal is None or not np.any(normal) or not _is_number(offset) or not link:
            return []
        normal = normal / np.linalg.norm(normal)
        origin = pose(normal * float(offset), axes_along(normal))
        size = [2.0 * PLANE_M, 2.0 * PLANE_M, 0.002]
        return [{**_solid("box", size, origin), "link": link, "name": "half_space"}]

    def _obstacle(self, given: object) -> list[Shape]:
        if not isinstance(given, Mapping):
            return []
        link = self._robot.base_frame
        if given.get("frame") is not None:
            link = self._link(given, "frame") or ""
        drawn = _OBSTACLES.get(str(given.get("shape")), lambda _: None)(given)
        if drawn is None or not link:
            return []
        return [{**drawn, "link": link, "name": str(given.get("name", ""))[:64]}]


def _named(key: str, node: object, depth: int = 0) -> Iterator[Mapping[str, Any]]:
    """Mappings with a name under that key, as configs write tasks and constraints."""
    if depth > DEEPEST:
        return
    if isinstance(node, Mapping):
        if isinstance(node.get(key), str):
            yield node
        for value in node.values():
            yield from _named(key, value, depth + 1)
    elif isinstance(node, list):
        for value in node[: 4 * MOST]:
            yield from _named(key, value, depth + 1)


def _below(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    found = entry.get("parameters")
    return found if isinstance(found, Mapping) else {}


def _is_target(told: object) -> bool:
    """Whether it is what a controller says of a live target, as far as we rest on it."""
    if not isinstance(told, Mapping) or not isinstance(told.get("name"), str):
        return False
    sizes = told.get("dimension"), told.get("rates")
    return all(isinstance(size, int) and 0 < size <= 128 for size in sizes)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < FAR


def _triple(value: object) -> Any:
    """Three numbers, (3,), or None."""
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
        return None
    return np.array(value, float)


def _solid(shape: str, size: list[float], origin: list[float]) -> Shape:
    return {"shape": shape, "size": size, "origin": origin, "color": list(FORBIDDEN)}


def _sphere(given: Mapping[str, Any]) -> Shape | None:
    center, radius = _triple(given.get("center_m")), given.get("radius_m")
    if center is None or not _is_number(radius):
        return None
    return _solid("sphere", [float(radius or 0.0)], pose(center, np.eye(3)))


def _capsule(given: Mapping[str, Any]) -> Shape | None:
    ends, radius = given.get("ends_m"), given.get("radius_m")
    if not isinstance(ends, list) or len(ends) != 2 or not _is_number(radius):
        return None
    first, second = (_triple(end) for end in ends)
    if first is None or second is None:
        return None
    size = [float(radius or 0.0), float(np.linalg.norm(second - first))]
    return _solid("capsule", size, pose((first + second) / 2, axes_along(second - first)))


def _box(given: Mapping[str, Any]) -> Shape | None:
    center, size = _triple(given.get("center_m")), _triple(given.get("size_m"))
    turned = _triple(given.get("rpy_rad", [0.0, 0.0, 0.0]))
    if center is None or size is None or turned is None:
        return None
    return _solid("box", size.tolist(), pose(center, rotation(*turned)))


_OBSTACLES = {"sphere": _sphere, "capsule": _capsule, "box": _box}
