"""Distances by Coal between the shapes as they were given: those of the URDF, and obstacles."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model, one_coordinate_each

FINE = coal.DistanceRequest()
FINE.gjk_tolerance = 1e-9

Shape = tuple[Any, FloatArray, FloatArray]  # and its centre and axes in its frame


def of_links(robot: RobotDescription) -> dict[str, list[Shape]]:
    """The <collision> shapes of each link as Pinocchio reads them, in the axes of the link."""
    model, found = build_model(robot).model, {}
    shapes = pin.buildGeomFromUrdfString(model, one_coordinate_each(robot), pin.COLLISION)
    for shape in shapes.geometryObjects:
        frame = model.frames[shape.parentFrame]
        here = frame.placement.actInv(shape.placement)
        placed = (shape.geometry, here.translation.copy(), here.rotation.copy())
        found.setdefault(frame.name, []).append(placed)
    return found


def of_obstacle(given: dict[str, Any]) -> Shape:
    """An obstacle as a config gives it."""
    if given["shape"] == "capsule":
        first, second = np.array(given["ends_m"])
        along = second - first
        length = float(np.linalg.norm(along))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).matrix()
        return coal.Capsule(given["radius_m"], length), (first + second) / 2, turn
    center = np.array(given["center_m"])
    if given["shape"] == "sphere":
        return coal.Sphere(given["radius_m"]), center, np.eye(3)
    turn = pin.rpy.rpyToMatrix(np.array(given.get("rpy_rad", (0.0, 0.0, 0.0))))
    return coal.Box(*given["size_m"]), center, turn


class Scene:
    """A robot's shapes and obstacles, wherever the robot is."""

    def __init__(self, robot: RobotDescription, obstacles: Any = ()) -> None:
        self.model = pin.buildModelFromXML(robot.urdf)
        self.data = self.model.createData()
        order = [self.model.joints[self.model.getJointId(name)].idx_q
                 for name in robot.joint_names]  # fmt: skip
        self.order = np.array(order)
        self.shapes = {name: [(name, *each) for each in shapes]
                       for name, shapes in of_links(robot).items()}  # fmt: skip
        for each in obstacles:
            frame = each.get("frame") or robot.base_frame
            self.shapes[each["name"]] = [(frame, *of_obstacle(each))]

    def at(self, q: FloatArray) -> Scene:
        """Move the robot."""
        inside = np.zeros(self.model.nq)
        inside[self.order] = q
        pin.framesForwardKinematics(self.model, self.data, inside)
        return self

    def distance(self, first: str, second: str) -> float:
        """Of two links or obstacles [m]; how deep they overlap, negative."""
        return min(
            float(coal.distance(*self._placed(one), *self._placed(other), FINE,
                                coal.DistanceResult()))
            for one in self.shapes[first]
            for other in self.shapes[second]
        )  # fmt: skip

    def _placed(self, shape: Any) -> tuple[Any, Any]:
        frame, geometry, center, axes = shape
        place = self.data.oMf[self.model.getFrameId(frame)]
        return geometry, coal.Transform3s(place.rotation @ axes, place.act(center))
