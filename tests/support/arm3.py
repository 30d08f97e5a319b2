"""A three-joint arm, as a user would write it: the smallest robot that tests need."""

from __future__ import annotations

from pathlib import Path

from hoap3.protocol.robot.description import Joint, RobotDescription

URDF = """<?xml version="1.0"?>
<robot name="arm3">
  <link name="base"/>

  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper_arm"/>
    <origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" velocity="2.0" effort="20"/>
  </joint>
  <link name="upper_arm">
    <inertial>
      <origin xyz="0.15 0 0"/>
      <mass value="2.0"/>
      <inertia ixx="0.002" iyy="0.016" izz="0.016" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>
      <origin xyz="0.15 0 0"/>
      <geometry><box size="0.3 0.06 0.06"/></geometry>
    </visual>
  </link>

  <joint name="elbow" type="revolute">
    <parent link="upper_arm"/>
    <child link="forearm"/>
    <origin xyz="0.3 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="0.1" upper="2.4" velocity="2.5" effort="12"/>
  </joint>
  <link name="forearm">
    <inertial>
      <origin xyz="0.12 0 0"/>
      <mass value="1.2"/>
      <inertia ixx="0.001" iyy="0.006" izz="0.006" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>

  <joint name="wrist" type="revolute">
    <parent link="forearm"/>
    <child link="hand"/>
    <origin xyz="0.25 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="4.0" effort="4"/>
  </joint>
  <link name="hand">
    <inertial>
      <origin xyz="0.05 0 0"/>
      <mass value="0.4"/>
      <inertia ixx="0.0003" iyy="0.0005" izz="0.0005" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>

  <joint name="tool_joint" type="fixed">
    <parent link="hand"/>
    <child link="tool"/>
    <origin xyz="0.1 0 0"/>
  </joint>
  <link name="tool"/>
</robot>
"""

YAML = """name: arm3
urdf: arm3.urdf
"""


def write(folder: Path, yaml: str = YAML, urdf: str = URDF) -> Path:
    """Put the arm into a folder; returns its YAML file."""
    (folder / "arm3.urdf").write_text(urdf, encoding="utf-8")
    file = folder / "robot.yaml"
    file.write_text(yaml, encoding="utf-8")
    return file


def joint(name: str, **changes: object) -> Joint:
    """A joint of the arm, with some fields changed."""
    fields = {
        "name": name,
        "lower_hard": -2.6,
        "upper_hard": 2.6,
        "lower": -2.5,
        "upper": 2.5,
        "velocity": 2.0,
        "setpoint_acceleration_max": 500.0,
        "brake_acceleration": 20.0,
        "effort": 20.0,
    }
    return Joint(**{**fields, **changes})


def describe(**changes: object) -> RobotDescription:
    """The arm, with some fields of its description changed."""
    fields = {
        "name": "arm3",
        "urdf": URDF,
        "joints": tuple(joint(name) for name in ("shoulder", "elbow", "wrist")),
        "initial_posture": "bent",
        "postures": {"bent": (0.0, 1.0, -0.5)},
        "base_frame": "base",
    }
    return RobotDescription(**{**fields, **changes})
