"""What a robot stands on: contact points and forces, zero-moment point, support polygon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.support.polygon import hull
from hoap3.tools.picture.poses import Poses

LEAST_N = 1e-3  # of a force that is drawn, and counts
BEARS = 0.01  # least share of the vertical force of a sole that counts as standing


class Contacts:
    """Reads forces out of States, and puts them into the world.

    Args:
        description: of the robot.
        emulator: its configuration, as it tells it; None where it does not.
        soles: that stand where State has no forces.
    """

    def __init__(
        self, description: RobotDescription, emulator: object, soles: Sequence[str] = ()
    ) -> None:
        self._soles = {sole.frame: np.array(sole.polygon) for sole in description.soles}
        self._standing = tuple(soles)
        length = description.state_arrays.get("contact", 0)
        frames = [frame for frame in _contact_frames(emulator) if frame in description.frames]
        frames = frames or list(self._soles)
        self._felt = frames if 6 * len(frames) == length else []
        self._sensors = description.wrench_sensors

    def look(self, state: State, poses: Poses) -> dict[str, Any]:
        """`contacts`, `zmp` and `polygon` of a frame.

        Args:
            state: whose forces count.
            poses: of the robot at that State.
        """
        wrenches = [(link, state.contact[6 * i : 6 * i + 6]) for i, link in enumerate(self._felt)]
        standing, zmp = self._standing, None
        if wrenches and np.isfinite(state.contact).all():
            bearing = [(link, _in_world(w, poses.placement(link))) for link, w in wrenches]
            zmp = _zmp([each for link, each in bearing if link in self._soles])
            up = {link: float(each[1][2]) for link, each in bearing if link in self._soles}
            total = sum(max(each, 0.0) for each in up.values())
            standing = tuple(link for link in up if up[link] > max(BEARS * total, LEAST_N))
        sensed = [(link, state.wrench[6 * i : 6 * i + 6]) for i, link in enumerate(self._sensors)]
        contacts = [_point(wrench, poses.placement(link)) for link, wrench in (*wrenches, *sensed)]
        return {
            "contacts": [each for each in contacts if each is not None],
            "zmp": zmp,
            "polygon": self._polygon(standing, poses),
        }

    def _polygon(self, soles: Sequence[str], poses: Poses) -> list[list[float]] | None:
        """Convex hull of the soles that stand, seen from above, [[x, y], …] [m]."""
        corners = [
            poses.placement(sole).act(np.array([x, y, 0.0]))[:2]
            for sole in soles
            for x, y in self._soles[sole]
        ]
        return hull(np.array(corners)).tolist() if corners else None


def _contact_frames(emulator: object) -> list[str]:
    """`plant.parameters.contact_frames` of an emulator config, or nothing."""
    found = emulator
    for key in ("plant", "parameters", "contact_frames"):
        found = found.get(key) if isinstance(found, Mapping) else None
    return [str(each) for each in found[:64]] if isinstance(found, list) else []


def _point(wrench: FloatArray, placement: Any) -> dict[str, list[float]] | None:
    """Where a force acts, and what it is, in the world; None where there is none.

    In the frame's plane z = 0 that is the centre of pressure, (−ty, tx) / fz.
    """
    force, torque = wrench[:3], wrench[3:]
    if not np.isfinite(wrench).all() or float(np.linalg.norm(force)) < LEAST_N:
        return None
    at = np.zeros(3)
    if force[2] > LEAST_N:
        at[:2] = -torque[1] / force[2], torque[0] / force[2]
    return {
        "at": np.round(placement.act(at), 6).tolist(),
        "force": np.round(placement.rotation @ force, 4).tolist(),
    }


def _in_world(wrench: FloatArray, placement: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Origin of the frame, force, and torque about it, each (3,) in the world."""
    rotation = placement.rotation
    return placement.translation, rotation @ wrench[:3], rotation @ wrench[3:]


def _zmp(wrenches: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> list[float] | None:
    """Where the forces of the ground have no torque about x and y, (x, y) [m]; None in the air.

    In the plane at the mean height of the soles, each weighed by its vertical force.
    """
    up = sum(float(force[2]) for _, force, _ in wrenches)
    if not up > LEAST_N:
        return None
    height = sum(float(force[2] * at[2]) for at, force, _ in wrenches) / up
    tx = ty = 0.0
    for at, force, torque in wrenches:
        arm = at - np.array([0.0, 0.0, height])
        moment = np.cross(arm, force) + torque
        tx, ty = tx + float(moment[0]), ty + float(moment[1])
    return [round(-ty / up, 6), round(tx / up, 6)]
