"""Motions in files: what is wrong is one error that says where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.trajectories.motion_file import (
    QUATERNION,
    column_title,
    read_motion,
)
from hoap3.remote_controller.references.trajectories.trajectory_settings import (
    AXES,
    TrajectorySettings,
)
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.robot_emulator.robots import load

UR5 = load("ur5")
ELBOW = "elbow_joint"
GOOD = f"t,{ELBOW}\n0,1.6\n1,1.5\n2,1.4\n"
BAD = {
    "falling": (GOOD.replace("2,1.4", "0.5,1.4"), "line 4, column t", 0.5),
    "equal": (GOOD.replace("2,1.4", "1.0,1.4"), "line 4, column t", 1.0),
    "clock": (GOOD.replace("2,1.4", "1.7e9,1.4"), "line 4, column t", 1.7e9),
    "negative": (GOOD.replace("0,1.6", "-1,1.6"), "line 2, column t", -1.0),
    "nan": (GOOD.replace("1.5", "nan"), f"line 3, column {ELBOW}", "nan"),
    "inf": (GOOD.replace("1.5", "inf"), f"line 3, column {ELBOW}", "inf"),
    "a word": (GOOD.replace("1.5", "far"), f"line 3, column {ELBOW}", "far"),
    "nothing": (GOOD.replace("1.5", ""), f"line 3, column {ELBOW}", ""),
    "a row": (GOOD.replace("1,1.5", "1"), "line 3", "1"),
    "one row": (f"t,{ELBOW}\n0,1.6\n", "", 1),
    "no row": (f"t,{ELBOW}\n", "", 0),
    "empty": ("\n\n", "", None),
    "time": (GOOD.replace("t,", "time,"), "line 1", "time"),
    "twice": (f"t,{ELBOW},{ELBOW}/position\n0,1,1\n1,1,1\n", "line 1", f"{ELBOW}/position"),
    "unknown joint": (GOOD.replace("elbow", "elbo"), "line 1", "elbo_joint"),
    "unknown part": (GOOD.replace(ELBOW, f"{ELBOW}/jerk"), "line 1", f"{ELBOW}/jerk"),
    "velocities alone": (GOOD.replace(ELBOW, f"{ELBOW}/velocity"), "line 1", ELBOW),
    "accelerations without velocities": (
        f"t,{ELBOW},{ELBOW}/acceleration\n0,1.6,0\n1,1.5,0\n",
        "line 1",
        f"t,{ELBOW},{ELBOW}/acceleration",
    ),
    "velocities of some": (
        f"t,{ELBOW},wrist_1_joint,{ELBOW}/velocity\n0,1.6,0,0\n1,1.5,0,0\n",
        "line 1",
        "wrist_1_joint",
    ),
    "not at rest": (
        f"t,{ELBOW},{ELBOW}/velocity\n0,1.6,0\n1,1.5,0.1\n",
        f"line 3, column {ELBOW}/velocity",
        0.1,
    ),
    "out of range": (GOOD.replace("1.5", "3.5"), f"line 3, column {ELBOW}", 3.5),
    "a jump": (GOOD.replace("1.4", "-3"), f"line 4, column {ELBOW}", -3.0),
}
BAD_POSES = {
    "long": ("0,0,0,0,0,0,0,1\n1,0,0,0,0.5,0.5,0.5,0.6\n", "line 3, column qx", None),
    "zero": ("0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,1\n", "line 2, column qx", None),
}


def refusal(csv: str, **settings: object) -> ConfigError:
    target = {"kind": "trajectory", "csv": csv, "file": "a.csv", **settings}
    task = TaskSettings(task="posture", parameters={"target": target})
    with pytest.raises(ConfigError) as caught:
        build(task, UR5, Kinematics(UR5), "there/config.yaml")
    return caught.value


@pytest.mark.parametrize("name", BAD)
def test_a_bad_motion_is_one_error_that_names_file_line_column_and_value(name):
    csv, where, value = BAD[name]
    error = refusal(csv)
    assert (error.file, error.key, error.value) == (str(Path("there/a.csv")), where, value)
    assert error.remedy
    assert not error.others


@pytest.mark.parametrize("name", BAD_POSES)
def test_a_quaternion_of_another_length_is_refused(name):
    rows, where, _ = BAD_POSES[name]
    with pytest.raises(ConfigError) as caught:
        read_motion("t,x,y,z,qx,qy,qz,qw\n" + rows, "a.csv", AXES, turns=True)
    assert caught.value.key == where
    with pytest.raises(ConfigError):  # and a part of one
        read_motion("t,x,y,z,qx\n0,0,0,0,1\n1,0,0,0,1\n", "a.csv", AXES, turns=True)


def test_a_jump_fits_with_the_time_scaling_that_its_error_says():
    """|Δq|/Δt ≤ the limit: whatever the interpolation, less time is not enough."""
    csv = GOOD.replace("1.4", "-3")
    least = (1.5 + 3.0) / UR5.velocity[UR5.joint_names.index(ELBOW)]
    assert f"{least:.4g}" in refusal(csv).remedy
    target = {"kind": "trajectory", "csv": csv}
    for scaling, good in ((least * 0.999, False), (least * 1.001, True)):
        given = {"target": {**target, "time_scaling": scaling}}
        task = TaskSettings(task="posture", parameters=given)
        if good:
            build(task, UR5, Kinematics(UR5))
        else:
            refusal(csv, time_scaling=scaling)


@pytest.mark.parametrize(
    ("parameters", "key"),
    [
        ({"target": {"kind": "trajectory"}}, "target"),
        ({"target": {"kind": "trajectory", "csv": GOOD}, "posture": "elbow_up"}, ""),
        ({"target": {"kind": "trajectory", "csv": GOOD}, "approach_s": 1.0}, ""),
        (
            {"target": {"kind": "trajectory", "csv": GOOD, "path_tolerance": {"elbow": 1}}},
            "path_tolerance.elbow",
        ),
        (
            {"target": {"kind": "trajectory", "csv": GOOD}, "joints": ["wrist_1_joint"]},
            "line 1",
        ),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_their_key(parameters, key):
    with pytest.raises(ConfigError) as caught:
        build(TaskSettings(task="posture", parameters=parameters), UR5, Kinematics(UR5))
    assert key in caught.value.key


@pytest.mark.parametrize("name", ["none.csv", "a.mcap", "."])
def test_a_file_that_cannot_be_read_is_named(name, tmp_path):
    settings = parse(TrajectorySettings, {"kind": "trajectory", "file": name}, "config")
    with pytest.raises(ConfigError) as caught:
        settings.build(tmp_path)
    assert caught.value.file == str(tmp_path / name)


def test_columns_may_stand_in_any_order_and_blank_lines_between():
    csv = "t,b/velocity,a,b,a/velocity\n\n0.5,1,2,3,4\n\n1.5,5,6,7,8\n"
    found = read_motion(csv, "a.csv", ("a", "b", "c"))
    assert found.names == ("a", "b")
    np.testing.assert_array_equal(found.positions, [[2, 3], [6, 7]])
    np.testing.assert_array_equal(found.velocities, [[4, 1], [8, 5]])
    np.testing.assert_array_equal(found.lines, [3, 5])


CELLS = st.sampled_from(["t", "x", "y", "x/velocity", *QUATERNION, "0", "1", "2.5", "nan", "", '"'])


@settings(max_examples=60)
@given(rows=st.lists(st.lists(CELLS, max_size=8), max_size=5), rest=st.text(max_size=20))
@example(rows=[["t", "x"], ["0", "1"], ["1", "2.5"]], rest="")
def test_any_text_is_a_motion_or_one_error(rows, rest):
    text = "\n".join(",".join(row) for row in rows) + rest
    refused, found = None, None
    try:
        found = read_motion(text, "a.csv", AXES, turns=True)
    except ConfigError as error:
        refused = error
    if found is None:
        assert (refused.file, refused.others) == ("a.csv", ())
    else:
        assert (np.diff(found.times_s) > 0.0).all()
        assert np.isfinite(found.positions).all()


NAMES = ("a", "a/velocity", "arm/j1", "t", "qx", "x", "a.b", "-")


def test_columns_of_joints_whose_names_have_slashes_and_words_of_ours_are_theirs():
    titles = [column_title(name) for name in NAMES]
    header = ["t", *titles, *(f"{title}/velocity" for title in titles)]
    rows = [[k, *np.arange(8) + k, *np.zeros(8)] for k in range(2)]
    text = "\n".join(",".join(map(str, row)) for row in [header, *rows])
    found = read_motion(text, "a.csv", NAMES)
    assert found.names == NAMES
    np.testing.assert_array_equal(found.positions[0], np.arange(8))
    np.testing.assert_array_equal(found.velocities, np.zeros((2, 8)))


def test_a_column_that_may_be_two_things_is_refused_with_both_spellings():
    for title, positions, velocities in (
        ("a/velocity", None, None),
        ("a%2Fvelocity", ("a", "a/velocity"), None),
        ("%61/velocity", ("a",), [[2.0], [4.0]]),
    ):
        csv = f"t,a,{title}\n0,1,2\n1,3,4\n"
        if positions is None:
            with pytest.raises(ConfigError, match=r"a%2Fvelocity.*%61/velocity"):
                read_motion(csv, "a.csv", NAMES)
            continue
        found = read_motion(csv, "a.csv", NAMES)
        assert found.names == positions
        assert (found.velocities is None) == (velocities is None)
