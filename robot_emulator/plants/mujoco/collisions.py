"""What stands around a robot, and which of its links can touch what."""

from __future__ import annotations

from itertools import combinations
from typing import Any

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.rerooted_urdf import body_of, rotation_of
from hoap3.robot_emulator.plants.mujoco.settings import FloorSettings, MujocoParameters

AROUND, ROBOT, BASE = 1, 2, 4
"""Bits of what geoms are: what stands around, links that move, links that the world holds."""

APART = 3  # joints between links that may touch each other


def surround(spec: Any, mujoco: Any, parameters: MujocoParameters) -> None:
    """The floor and the boxes."""
    floor = parameters.floor
    if floor is None and parameters.base == "free" and parameters.mjcf is None:
        floor = FloorSettings()
    around = {"contype": AROUND, "conaffinity": 0}
    if floor is not None:
        plane = spec.worldbody.add_geom(name="floor", size=[5.0, 5.0, 0.1], **around)
        plane.type = mujoco.mjtGeom.mjGEOM_PLANE
        plane.pos, plane.friction = [0.0, 0.0, floor.height_m], [floor.friction, 0.005, 0.0001]
    for number, each in enumerate(parameters.boxes):
        box = spec.worldbody.add_geom(name=f"box {number}", **around)
        box.type, box.size = mujoco.mjtGeom.mjGEOM_BOX, [0.5 * size for size in each.size_m]
        mujoco.mju_mat2Quat(box.quat, rotation_of(each.rotation_rad).ravel())
        box.pos, box.friction = each.position_m, [each.friction, 0.005, 0.0001]


def let_touch(spec: Any, description: RobotDescription, parameters: MujocoParameters) -> None:
    """Let the chosen links touch what stands around, and each other.

    Raises:
        ConfigError: the robot has no such link.
    """
    links = {body_of(link) for link in _chosen(description, parameters)}
    for body in spec.bodies[1:]:
        moves = _carrier(body).name != "world"
        for geom in body.geoms:
            geom.contype = geom.conaffinity = 0
            if body.name in links:
                geom.contype = ROBOT if moves else BASE
                geom.conaffinity = AROUND | ROBOT | BASE if moves else 0


def keep_apart(spec: Any, model: Any, data: Any) -> None:
    """Let links less than `APART` joints apart, or that touch at the start, not touch each other.

    Covers overlap, and so do the shapes that stand for meshes.

    Args:
        spec: is changed.
        model: what became of a copy of it.
        data: of that model, in the start posture.
    """
    pairs = {tuple(sorted(model.geom_bodyid[pair])) for pair in data.contact.geom}
    ours = sorted({int(body) for body, kind in _kinds(model) if kind == ROBOT})
    pairs |= {pair for pair in combinations(ours, 2) if _joints_between(model, *pair) < APART}
    pairs |= {(0, body) for body in ours if _joints_between(model, 0, body) < APART}
    held = set()
    for first, second in sorted(pairs):
        if first > 0:
            names = model.body(first).name, model.body(second).name
            spec.add_exclude(bodyname1=names[0], bodyname2=names[1])
        else:  # an exclusion would be from what stands around, too
            held.add(model.body(second).name)
    for body in spec.bodies[1:]:
        if _carrier(body).name in held:
            for geom in body.geoms:
                geom.conaffinity &= ~BASE


def _kinds(model: Any) -> list[tuple[int, int]]:
    return list(zip(model.geom_bodyid, model.geom_contype, strict=True))


def _chosen(description: RobotDescription, parameters: MujocoParameters) -> set[str]:
    links = set(description.frames)
    if isinstance(parameters.collide, tuple):
        for number, name in enumerate(parameters.collide):
            if name not in links:
                hint = one_of(name, sorted(links), "Its links")
                problem = f"robot {description.name!r} has no such link"
                raise ConfigError("", f"parameters.collide.{number}", name, problem, hint)
        return set(parameters.collide)
    if parameters.collide == "none":
        return set()
    if parameters.collide == "all" or not description.soles:
        return links
    parents = {joint.child: joint for joint in description.structure.joints}
    found = set()
    for sole in description.soles:  # a sole is a frame: the link that it is fixed to has the shape
        link = sole.frame
        while link in parents and parents[link].kind == "fixed":
            found.add(link)
            link = parents[link].parent
        found.add(link)
    return found


def _carrier(body: Any) -> Any:
    """The body that a body is fixed to: one with a joint, or the world."""
    while body.name != "world" and not len(body.joints):
        body = body.parent
    return body


def _joints_between(model: Any, first: int, second: int) -> int:
    """How many bodies, each with its joint, lie between two bodies in the tree."""
    above = {first: 0}
    while first:
        first = int(model.body_parentid[first])
        above[first] = len(above)
    steps = 0
    while second not in above:
        second = int(model.body_parentid[second])
        steps += 1
    return steps + above[second]
