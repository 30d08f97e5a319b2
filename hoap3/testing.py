"""Property suites: what every controller, task, constraint, plant and robot must do.

Each is a class of tests for pytest. Derive yours from it in a test file, and name what it shall run
over:

    from hoap3.testing import ControllerProperties

    class TestPosture(ControllerProperties):
        cases = ("posture.yaml", "qp12")

They need `pip install 'hoap3[testing]'`: pytest, and Gymnasium, which steps robots.
"""

from hoap3.tools.testing.body import Body, moved, state_of
from hoap3.tools.testing.constraints import ConstraintCase, ConstraintProperties
from hoap3.tools.testing.controllers import ControllerProperties
from hoap3.tools.testing.numerics import posture, quotient
from hoap3.tools.testing.plants import PlantCase, PlantProperties
from hoap3.tools.testing.robots import RobotProperties
from hoap3.tools.testing.tasks import TaskCase, TaskProperties

__all__ = [
    "Body",
    "ConstraintCase",
    "ConstraintProperties",
    "ControllerProperties",
    "PlantCase",
    "PlantProperties",
    "RobotProperties",
    "TaskCase",
    "TaskProperties",
    "moved",
    "posture",
    "quotient",
    "state_of",
]
