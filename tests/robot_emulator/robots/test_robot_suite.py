"""The property suite of robots finds what is wrong with one."""

from __future__ import annotations

import pytest
from support import arm3

from hoap3.testing import RobotProperties
from hoap3.tools.testing.robots import RobotCase

YAML = """name: arm3
urdf: arm3.urdf
command_kinds: [position, torque]
postures: {bent: [0.0, 1.0, -0.5]}
initial_posture: bent
"""
FAULTS = {
    "faultless": (YAML, arm3.URDF, ""),
    "a moment beyond the sum of the others": (
        YAML,
        arm3.URDF.replace('izz="0.006"', 'izz="0.06"'),
        "every_inertia",
    ),
    "a posture between the usable range and the stops": (
        YAML.replace("1.0, -0.5]}", "2.45, -0.5]}")
        + "joints: [shoulder, {name: elbow, upper_hard: 2.5}, wrist]\n",
        arm3.URDF,
        "postures_are_usable",
    ),
    "brakes of which positions use a part": (
        YAML + "setpoint_acceleration_max: 10.0\nbrake_acceleration: 20.0\n",
        arm3.URDF,
        "",
    ),
    "too weak for itself": (
        YAML,
        arm3.URDF.replace('effort="12"', 'effort="1"'),
        "hold_itself",
    ),
}


@pytest.mark.filterwarnings("ignore")  # what such a robot is warned of
@pytest.mark.parametrize("name", FAULTS)
def test_the_suite_finds_the_fault(name, tmp_path):
    yaml, urdf, fault = FAULTS[name]
    arm3.write(tmp_path, yaml, urdf)
    case = RobotCase(str(tmp_path))
    failed = set()
    for test in (each for each in dir(RobotProperties) if each.startswith("test_")):
        kinds = case.robot.command_kinds if "whatever_is_asked" in test else (None,)
        for kind in kinds:
            try:
                getattr(RobotProperties(), test)(case, *filter(None, [kind]))
            except AssertionError:
                failed.add(test)
    assert bool(failed) == bool(fault), failed
    assert any(fault in test for test in failed) or not fault
