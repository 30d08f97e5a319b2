"""The URDFs of the wheel `example-robot-data`, as their vendors wrote them."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path
from xml.etree import ElementTree as ET

MOVABLE = ("revolute", "continuous", "prismatic")


def _all() -> dict[str, Path]:
    """By name, as folder/file below `robots`."""
    wheel = distribution("example-robot-data")
    found = {}
    for file in sorted(wheel.files or [], key=str):
        if file.suffix == ".urdf":
            path = Path(str(wheel.locate_file(file)))
            found["/".join(file.parts[file.parts.index("robots") + 1 :])] = path
    return found


EXAMPLES = _all()


def joints(path: Path) -> dict[str, ET.Element]:
    """The joints of a file that move, by name, in its order."""
    found = ET.parse(path).getroot().findall("joint")
    return {str(each.get("name")): each for each in found if each.get("type") in MOVABLE}


MOVING = {name: path for name, path in EXAMPLES.items() if joints(path)}
"""Those with a movable joint."""

REFUSED = {
    "alex_description/urdf/alex_psyonic_hands.urdf": "joint 'Left_index_q2'.*'index_q1'.*no joint",
}
"""Those of them that are wrong, and what is said of them."""

FEW = (
    "allegro_hand_description/urdf/allegro_left_hand.urdf",
    "asr_twodof_description/urdf/TwoDofs.urdf",
    "baxter_description/urdf/baxter.urdf",
    "bolt_description/robots/bolt.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "iris_description/robots/iris.urdf",
    "kinova_description/robots/kinova.urdf",
    "panda_description/urdf/panda_collision.urdf",
    "pr2_description/urdf/pr2.urdf",
    "quadruped_description/urdf/quadruped.urdf",
    "simple_humanoid_description/urdf/simple_humanoid.urdf",
    "ur_description/urdf/ur5_robot.urdf",
)
"""Twelve that have, between them, mimic joints, joints without limits, and meshes."""
