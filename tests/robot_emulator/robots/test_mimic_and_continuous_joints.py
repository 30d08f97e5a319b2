"""Robot files with mimic joints and continuous joints."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from support.robots.following_arm import URDF, YAML, following_arm

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots.mimic_limits import mimic_joint_notes

LIMITS = ("lower", "upper", "lower_hard", "upper_hard")


def test_mimic_joints_are_none_of_the_joints(tmp_path):
    arm = following_arm(tmp_path)
    assert arm.joint_names == ("finger", "turn", "elbow", "lift", "roll")
    assert set(arm.structure.mimic_joints) == {"far_elbow", "thumb", "thumb_tip"}


def test_without_a_list_the_joints_are_those_that_follow_no_others(tmp_path):
    yaml = "name: following\nurdf: arm.urdf\n"
    assert following_arm(tmp_path, yaml).joint_names == ("turn", "lift", "elbow", "roll", "finger")


def test_limits_of_a_mimicked_joint_are_narrowed_by_its_mimic_joints(tmp_path):
    """far_elbow = 0.5·elbow + 0.1 within ±1; thumb_tip = 8·finger − 0.06, as fast as 1.2 rad/s."""
    arm = following_arm(tmp_path)
    finger, _, elbow, lift, _ = arm.joints
    assert (elbow.lower, elbow.upper) == pytest.approx((-2.2, 1.8), abs=1e-15)
    assert (elbow.lower_hard, elbow.upper_hard) == (elbow.lower, elbow.upper)
    assert (elbow.velocity, elbow.effort) == (3.0, 60.0)
    assert (finger.lower, finger.upper) == (0.0, 0.05)
    assert finger.velocity == pytest.approx(0.15, abs=1e-15)
    assert (lift.lower, lift.upper, lift.velocity) == (-1.5, 1.5, 2.0)


def test_a_falling_ratio_swaps_the_ends(tmp_path):
    """far_elbow = −2·elbow + 0.1 within −1.0 and 0.5: elbow within −0.2 and 0.55."""
    urdf = URDF.replace('multiplier="0.5"', 'multiplier="-2"').replace(
        '<limit lower="-1.0" upper="1.0"', '<limit lower="-1.0" upper="0.5"'
    )
    elbow = following_arm(tmp_path, YAML.replace("0.7", "0.3"), urdf).joints[2]
    assert (elbow.lower, elbow.upper) == pytest.approx((-0.2, 0.55), abs=1e-15)
    assert elbow.velocity == 1.0


def test_the_file_has_the_last_word_on_a_mimicked_joint(tmp_path):
    yaml = YAML.replace("{name: elbow, ", "{name: elbow, lower: -2.3, velocity: 2.5, ")
    elbow = following_arm(tmp_path, yaml).joints[2]
    assert (elbow.lower, elbow.velocity) == (-2.3, 2.5)


def test_what_becomes_of_limits_is_told_of_each_mimicked_joint(tmp_path):
    notes = mimic_joint_notes(following_arm(tmp_path))
    assert len(notes) == 2
    finger, elbow = notes
    assert re.search("'finger'.*thumb, thumb_tip.*velocity 0.15.* 0.2", finger)
    assert re.search("'elbow'.*far_elbow.*lower -2.2.* -2.5.*upper 1.8.* 2.5", elbow)
    wider = YAML.replace("{name: elbow, ", "{name: elbow, lower: -2.3, upper: 1.5, ")
    (_, elbow) = mimic_joint_notes(following_arm(tmp_path, wider))
    assert re.search("lower -2.3.* -2.2", elbow)
    assert "upper" not in elbow


def test_a_joint_that_its_mimic_joints_leave_no_room_is_refused(tmp_path):
    urdf = URDF.replace('multiplier="0.5" offset="0.1"', 'multiplier="0.5" offset="9"')
    with pytest.raises(DescriptionError, match=r"'elbow': .*'far_elbow'"):
        following_arm(tmp_path, urdf=urdf)


def test_a_mimic_joint_in_joints_is_refused_and_its_mimicked_joint_named(tmp_path):
    yaml = YAML.replace("[finger, turn", "[thumb, turn")
    with pytest.raises(DescriptionError, match=r"'thumb': .*'finger'"):
        following_arm(tmp_path, yaml)
    arm = following_arm(tmp_path)
    thumb = arm.joints[0].model_copy(update={"name": "thumb_tip"})
    with pytest.raises(DescriptionError, match=r"'thumb_tip': .*'finger'"):
        arm.model_copy(update={"joints": (thumb, *arm.joints[1:])})


def test_a_continuous_joint_has_no_position_limits_on_the_wire(tmp_path):
    arm = following_arm(tmp_path)
    told = json.loads(arm.to_json())
    for place, joint in enumerate(told["joints"]):
        endless = joint["name"] in ("turn", "roll")
        assert all((joint[key] is None) == endless for key in LIMITS)
        for key in LIMITS:
            sign = -1.0 if key.startswith("lower") else 1.0
            assert (getattr(arm, key)[place] == sign * math.inf) == endless
    twin = RobotDescription.from_json(arm.to_json())
    assert (twin, twin.digest) == (arm, arm.digest)


def test_a_continuous_joint_may_be_given_limits(tmp_path):
    yaml = YAML.replace("finger, turn,", "finger, {name: turn, lower: -3.0, upper: 2.0},")
    turn = following_arm(tmp_path, yaml).joints[1]
    assert [getattr(turn, key) for key in LIMITS] == [-3.0, 2.0, -3.0, 2.0]


def test_a_continuous_joint_needs_a_speed_and_an_effort(tmp_path):
    urdf = URDF.replace('<limit velocity="2" effort="80"/>', "")
    with pytest.raises(DescriptionError, match=r"'turn': .*velocity and effort"):
        following_arm(tmp_path, urdf=urdf)
    yaml = YAML.replace("turn,", "{name: turn, velocity: 1.0, effort: 5.0},")
    yaml = yaml.replace("{name: roll,", "{name: roll, velocity: 1.0, effort: 5.0,")
    assert following_arm(tmp_path, yaml, urdf).joints[1].effort == 5.0


def test_positions_are_drawn_from_one_turn_where_there_is_no_limit(tmp_path):
    yaml = YAML.replace("turn,", "{name: turn, upper: 1.0},").replace("roll,", "roll, lower: -2.0,")
    lower, upper = following_arm(tmp_path, yaml).sampling_range
    assert (lower[1], upper[1]) == (1.0 - math.tau, 1.0)
    assert (lower[4], upper[4]) == (-2.0, -2.0 + math.tau)
    arm = following_arm(tmp_path)
    lower, upper = arm.sampling_range
    assert (lower[1], upper[1]) == (-math.pi, math.pi)
    bounded = [0, 2, 3]
    np.testing.assert_array_equal(lower[bounded], arm.lower[bounded])
    np.testing.assert_array_equal(upper[bounded], arm.upper[bounded])


def test_an_encoder_that_does_not_wrap_needs_limits(tmp_path):
    yaml = YAML.replace("turn,", "{name: turn, encoder_counts_per_rad: 1000.0},")
    with pytest.raises(DescriptionError, match=r"'turn': encoder_counts_per_rad.*1000\.0"):
        following_arm(tmp_path, yaml)
    yaml = yaml.replace("1000.0", "1000.0, lower: -3.0, upper: 3.0")
    assert following_arm(tmp_path, yaml).joints[1].encoder_counts_per_rad == 1000.0


def test_no_other_joint_goes_without_limits(tmp_path):
    arm = following_arm(tmp_path)
    raw = json.loads(arm.to_json())
    raw["joints"][3] |= dict.fromkeys(LIMITS)
    with pytest.raises(DescriptionError, match=r"'lift': .*revolute"):
        RobotDescription.from_json(json.dumps(raw).encode())


def test_postures_of_a_continuous_joint_are_finite(tmp_path):
    arm = following_arm(tmp_path)
    far = arm.model_copy(update={"postures": {"bent": (0.01, 700.0, 0.7, 0.5, -0.3)}})
    assert far.initial_position[1] == 700.0
    for value in (math.inf, math.nan):
        with pytest.raises(DescriptionError, match="'turn'"):
            arm.model_copy(update={"postures": {"bent": (0.01, value, 0.7, 0.5, -0.3)}})
    assert arm.postures["zero"] == (0.0,) * 5
