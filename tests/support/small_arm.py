"""A three-joint arm for tests that need some robot, but none in particular."""

from __future__ import annotations

from hoap3.protocol.robot.description import Joint, RobotDescription

PERIOD_NS = 1_000_000


def _link(name: str) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, parent: str, child: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="3" effort="10"/></joint>'
    )


URDF = (
    '<robot name="arm">'
    + "".join(_link(name) for name in ("base", "upper", "fore", "hand"))
    + _joint("shoulder", "base", "upper", "0 1 0")
    + _joint("elbow", "upper", "fore", "0 1 0")
    + _joint("wrist", "fore", "hand", "1 0 0")
    + "</robot>"
)


def arm(**changes: object) -> RobotDescription:
    """The arm, with some fields of its description changed."""
    joints = tuple(
        Joint(
            name=name,
            lower_hard=-2.1,
            upper_hard=2.1,
            lower=-2.0,
            upper=2.0,
            velocity=3.0,
            setpoint_acceleration_max=1000.0,
            brake_acceleration=40.0,
            effort=10.0,
            encoder_counts_per_rad=scale,
        )
        for name, scale in (("shoulder", 10000.0), ("elbow", -10000.0), ("wrist", 10000.0))
    )
    fields: dict[str, object] = {
        "name": "arm",
        "urdf": URDF,
        "joints": joints,
        "initial_posture": "start",
        "postures": {"start": (0.1, -0.2, 0.3)},
        "base_frame": "base",
    }
    return RobotDescription(**{**fields, **changes})


def one_joint_arm() -> RobotDescription:
    """The shoulder of the small arm alone: two links of 1 kg."""
    urdf = arm().urdf
    cut = urdf.index('<joint name="elbow"')
    for link in ("fore", "hand"):
        start = urdf.index(f'<link name="{link}"')
        end = urdf.index("</link>", start) + len("</link>")
        urdf, cut = urdf[:start] + urdf[end:], cut - (end - start)
    return arm(urdf=urdf[:cut] + "</robot>", joints=arm().joints[:1], postures={"start": (0.1,)})
