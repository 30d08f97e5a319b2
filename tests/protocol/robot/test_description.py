"""A description holds together or is refused, and survives the wire with its fingerprint."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.arm3 import URDF, describe, joint

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import MAX_BYTES, DefaultTask, Joint, RobotDescription, Sole

SQUARE = ((0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1))
NAMES = ("shoulder", "elbow", "wrist")


def arm_json(**changes: object) -> bytes:
    """What a robot with some odd fields would send."""
    fields = json.loads(describe().to_json())
    return json.dumps({**fields, **changes}).encode()


def test_round_trip_keeps_bytes_digest_and_equality():
    arm = describe(
        soles=(Sole(frame="tool", polygon=SQUARE),), wrench_sensors=("hand",), period_s=0.002
    )
    twin = RobotDescription.from_json(arm.to_json())
    assert twin == arm
    assert twin.to_json() == arm.to_json()
    assert twin.digest == arm.digest
    assert len(arm.digest) == 64


def test_a_limit_of_jerk_travels_only_where_there_is_one():
    """So logs and programs from before there were any keep their bytes and their digests."""
    arm = describe()
    assert "setpoint_jerk_max" not in json.loads(arm.to_json())["joints"][0]
    assert np.all(np.isinf(arm.setpoint_jerk_max))
    fast = arm.joints[0].model_copy(update={"setpoint_jerk_max": 7e3})
    smooth = describe(joints=(fast, *arm.joints[1:]))
    twin = RobotDescription.from_json(smooth.to_json())
    assert twin.setpoint_jerk_max.tolist() == [7e3, np.inf, np.inf]
    assert twin.to_json() == smooth.to_json()
    assert twin.digest != arm.digest
    with pytest.raises(DescriptionError, match="setpoint_jerk_max"):
        Joint.model_validate({**fast.model_dump(), "setpoint_jerk_max": 0.0})


def test_a_rule_for_what_is_late_travels_only_where_it_is_not_the_usual_one():
    usual = describe(deadline="next_tick", delay_ticks=0, servo_rate_1_s=None)
    assert usual.to_json() == describe().to_json()
    assert not {"deadline", "delay_ticks", "servo_rate_1_s"} & json.loads(usual.to_json()).keys()
    arm = describe(deadline="after_receipt", delay_ticks=3)
    twin = RobotDescription.from_json(arm.to_json())
    assert (twin.deadline, twin.delay_ticks, twin.due) == ("after_receipt", 3, 4_000_000)
    assert twin.digest == arm.digest != usual.digest


@pytest.mark.parametrize("value", [-1, 101, 1.5, True, "1", None])
def test_a_delay_is_a_whole_number_of_ticks_within_bounds(value):
    with pytest.raises(DescriptionError, match="delay_ticks"):
        RobotDescription.from_json(arm_json(delay_ticks=value))


@given(
    angles=st.tuples(*[st.floats(-2.6, 2.6)] * 3),
    velocity=st.floats(1e-9, 1e12),
    polygon_size=st.floats(1e-6, 1e3),
)
def test_any_figures_survive_the_wire(angles, velocity, polygon_size):
    polygon = tuple((x * polygon_size, y * polygon_size) for x, y in SQUARE)
    arm = describe(
        joints=tuple(joint(name, velocity=velocity) for name in NAMES),
        postures={"bent": angles},
        soles=(Sole(frame="tool", polygon=polygon),),
    )
    assert RobotDescription.from_json(arm.to_json()).digest == arm.digest


def test_canonical_json_does_not_depend_on_the_order_of_keys():
    postures = {"bent": (0.0, 1.0, -0.5), "zero": (0.0, 0.0, 0.0)}
    backwards = dict(reversed(postures.items()))
    assert describe(postures=postures).digest == describe(postures=backwards).digest
    assert describe(postures=postures).digest != describe().digest


def test_arrays_are_in_wire_order_cached_and_read_only():
    joints = tuple(
        joint(name, velocity=float(k + 1), effort=10.0 + k, encoder_counts_per_rad=-100.0 * (k + 1))
        for k, name in enumerate(NAMES)
    )
    arm = describe(joints=joints)
    assert arm.n == 3
    assert arm.joint_names == NAMES
    assert arm.velocity.tolist() == [1.0, 2.0, 3.0]
    assert arm.effort.tolist() == [10.0, 11.0, 12.0]
    assert arm.initial_position.tolist() == [0.0, 1.0, -0.5]
    assert arm.counts_per_rad is not None
    assert arm.counts_per_rad.tolist() == [-100.0, -200.0, -300.0]
    for name in ("lower", "upper", "lower_hard", "upper_hard", "brake_acceleration"):
        assert getattr(arm, name).tolist() == [getattr(each, name) for each in joints]
    assert arm.setpoint_acceleration_max.tolist() == [500.0] * 3
    assert arm.lower is arm.lower
    assert arm.lower.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        arm.lower[0] = 0.0


def test_counts_are_none_unless_every_joint_has_a_scale():
    joints = (joint("shoulder", encoder_counts_per_rad=100.0), joint("elbow"), joint("wrist"))
    assert describe(joints=joints).counts_per_rad is None


def test_copy_with_changes_is_checked_and_has_its_own_fingerprint():
    arm = describe()
    digest, velocity = arm.digest, arm.velocity
    faster = arm.model_copy(
        update={"name": "arm4", "joints": tuple(joint(name, velocity=3.0) for name in NAMES)}
    )
    assert faster.name == "arm4"
    assert faster.digest != digest
    assert faster.velocity[0] == 3.0 != velocity[0]
    with pytest.raises(DescriptionError, match="robot 'Arm 4'"):
        arm.model_copy(update={"name": "Arm 4"})


REFUSED_JOINTS = [
    {"lower": 2.5, "upper": -2.5},
    {"lower": 1.0, "upper": 1.0},
    {"lower": -2.7},  # below the stop
    {"upper": 2.7},
    {"velocity": 0.0},
    {"velocity": -1.0},
    {"brake_acceleration": 0.0},
    {"setpoint_acceleration_max": 0.0},
    {"effort": 0.0},
    {"effort_average": 21.0},  # above the peak
    {"encoder_counts_per_rad": 0.0},
    {"armature": -0.1},
    {"upper": math.nan},
    {"velocity": math.inf},
    {"lower": math.inf},
    {"velocity": "2.0"},
    {"velocity": True},
    {"setpoint_jerk_max": 1e-300},
    {"velocity": 1e-12},
    {"brake_acceleration": 1e-10},
    {"velocity": 1e300},
    {"setpoint_acceleration_max": 1e13},
    {"effort": 1e300},
    {"armature": 1e300},
    {"encoder_counts_per_rad": -1e300},
    {"upper_hard": 1e300, "upper": 1e300},
]


@pytest.mark.parametrize("changes", REFUSED_JOINTS, ids=str)
def test_joint_is_refused_with_its_name_and_value(changes):
    key, value = next(iter(changes.items()))
    with pytest.raises(DescriptionError, match=r"^joint 'elbow': ") as caught:
        joint("elbow", **changes)
    assert key in str(caught.value)
    assert repr(value) in str(caught.value)


def test_missing_and_unknown_fields_are_named():
    with pytest.raises(DescriptionError, match=r"'elbow'.*lower_hard"):
        Joint(name="elbow")
    with pytest.raises(DescriptionError, match=r"'elbow'.*velocty.*'velocity'"):
        joint("elbow", velocty=2.0)


def test_joint_names_are_plain():
    with pytest.raises(DescriptionError, match="<b>elbow</b>"):
        joint("<b>elbow</b>")


REFUSED = {
    "name": ({"name": "Arm"}, "name.*'Arm'"),
    "long name": ({"name": "a" * 33}, "a" * 33),
    "no joints": ({"joints": ()}, "joints.*128"),
    "129 joints": ({"joints": tuple(joint(f"j{k}") for k in range(129))}, "joints.*128"),
    "joint twice": ({"joints": (joint("elbow"), joint("elbow"), joint("wrist"))}, "'elbow'"),
    "joint not in URDF": (
        {"joints": (joint("shoulder"), joint("elbw"), joint("wrist"))},
        "'elbw'.*'elbow'",
    ),
    "fixed joint": (
        {"joints": tuple(joint(name) for name in (*NAMES, "tool_joint"))},
        "'tool_joint'",
    ),
    "joint left out": (
        {"joints": (joint("shoulder"), joint("elbow")), "postures": {"bent": (0.0, 1.0)}},
        "'wrist'",
    ),
    "posture too short": ({"postures": {"bent": (0.0, 1.0)}}, "bent.*2.*3"),
    "posture with NaN": ({"postures": {"bent": (0.0, math.nan, 0.0)}}, "'elbow'.*nan"),
    "posture outside": (
        {"postures": {"bent": (0.0, 0.0, 2.61)}},
        r"'bent'.*'wrist'.*2\.61.*\[-2\.6, 2\.6\]",
    ),
    "no initial posture": ({"initial_posture": "bend"}, "'bend'.*'bent'"),
    "base frame": ({"base_frame": "bas"}, "'bas'.*'base'"),
    "sensor frame": ({"wrench_sensors": ("lidar",)}, "'lidar'"),
    "sensor twice": ({"wrench_sensors": ("hand", "hand")}, "'hand'"),
    "sole frame": ({"soles": (Sole(frame="foot", polygon=SQUARE),)}, "soles.*'foot'"),
    "period": ({"period_s": 0.0}, "period_s.*0.0"),
    "no command kind": ({"command_kinds": ()}, "command_kinds.*position"),
    "command kind": ({"command_kinds": ("velocity",)}, "'velocity'.*'acceleration'"),
    "kind twice": ({"command_kinds": ("torque", "torque")}, "'torque'"),
    "URDF": ({"urdf": URDF.replace('"revolute"', '"floating"')}, "'shoulder'.*floating"),
    "unknown key": ({"perod_s": 0.001}, "perod_s.*'period_s'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_description_is_refused_with_robot_key_and_value(case):
    changes, named = REFUSED[case]
    with pytest.raises(DescriptionError, match=rf"^robot '.*{named}"):
        describe(**changes)


def test_a_description_that_nobody_would_accept_cannot_be_made():
    postures = {f"bent{k or ''}": (0.0,) * 3 for k in range(50_000)}
    with pytest.raises(DescriptionError, match=rf"{MAX_BYTES}"):
        describe(postures=postures)


POLYGONS = {
    "clockwise": SQUARE[::-1],
    "two corners": SQUARE[:2],
    "no corners": (),
    "65 corners": tuple((math.cos(k), math.sin(k)) for k in np.arange(65) * math.tau / 65),
    "dent": ((0.1, 0.1), (0.0, 0.05), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1)),
    "star": tuple((math.cos(k), math.sin(k)) for k in np.arange(5) * 2 * math.tau / 5),
    "line": ((0.0, 0.0), (0.1, 0.0), (0.2, 0.0)),
    "point": ((0.1, 0.1),) * 3,
    "endless": tuple((1e200 * x, 1e200 * y) for x, y in SQUARE),
}


@pytest.mark.parametrize("case", POLYGONS)
def test_outline_of_a_sole_is_convex_and_counter_clockwise(case):
    with pytest.raises(DescriptionError, match=r"^sole 'tool': polygon"):
        Sole(frame="tool", polygon=POLYGONS[case])


def test_corners_in_a_line_are_accepted():
    middle = ((0.1, 0.1), (0.0, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1))
    assert Sole(frame="tool", polygon=middle).polygon == middle


FROM_WIRE = {
    "empty": b"",
    "not JSON": b"{",
    "a list": b"[]",
    "not UTF-8": b'{"name": "\xff"}',
    "lone surrogate": b'{"name": "\\ud800"}',
    "NaN": arm_json(period_s=math.nan),
    "infinite": arm_json().replace(b"0.001", b"1e999"),
    "huge integer": arm_json().replace(b"0.001", b"1" + b"0" * 400),
    "deep": b'{"name":' + b"[" * 100_000,
    "joints as text": arm_json(joints="abc"),
    "joints as numbers": arm_json(joints=[1, 2, 3]),
    "name as number": arm_json(name=3),
    "unknown key": arm_json(exec="rm"),
    "posture as text": arm_json(postures={"bent": "000"}),
}


@pytest.mark.parametrize("case", FROM_WIRE)
def test_wire_is_not_trusted(case):
    with pytest.raises(DescriptionError) as caught:
        RobotDescription.from_json(FROM_WIRE[case])
    assert len(str(caught.value)) < 500


def test_size_is_checked_before_anything_is_read():
    padding = b" " * (MAX_BYTES - len(describe().to_json()))
    assert RobotDescription.from_json(describe().to_json() + padding) == describe()
    with pytest.raises(DescriptionError, match=rf"{MAX_BYTES + 1}"):
        RobotDescription.from_json(describe().to_json() + padding + b" ")


def test_a_rate_of_servos_travels_and_must_be_one() -> None:
    arm = describe(servo_rate_1_s=9.5)
    assert RobotDescription.from_json(arm.to_json()).servo_rate_1_s == 9.5
    for wrong in (0.0, -1.0):
        with pytest.raises(DescriptionError, match="servo_rate_1_s"):
            describe(servo_rate_1_s=wrong)


def test_a_task_or_a_posture_of_no_size_is_refused():
    with pytest.raises(DescriptionError, match=r"target_m\.0.*1e\+300"):
        DefaultTask(point="tool", reference="base", target_m=(1e300, 0.0, 0.0))
