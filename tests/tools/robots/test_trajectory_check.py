"""`hoap3 trajectory check`: what it says is what dense samples of the motion say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.command_bench import Done, inside

from hoap3.remote_controller.references.trajectories.motion_file import Motion
from hoap3.remote_controller.references.trajectories.trajectory import Trajectory
from hoap3.robot_emulator.robots import load
from hoap3.tools.robots.polynomial_peaks import peaks, value
from hoap3.tools.robots.trajectory_check import look
from hoap3.tools.robots.trajectory_limits import limits_exceeded

UR5 = load("ur5")
JOINTS = [0, 2, 4]
NAMES = tuple(UR5.joint_names[i] for i in JOINTS)
DEGREES = ("linear", "cubic", "quintic")


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), degree=st.integers(0, 5))
def test_peaks_are_the_extremes_of_dense_samples(seed, degree):
    c = np.random.default_rng(seed).normal(size=(degree + 1, 6))
    c[-1, 0] = 0.0  # of a lower degree
    (least, low), (most, high) = peaks(c)
    samples = value(c, np.linspace(0.0, 1.0, 1001)[:, None] * np.ones(6))
    assert (low <= samples.min(0) + 1e-12).all()
    assert (high >= samples.max(0) - 1e-12).all()
    np.testing.assert_allclose(low, samples.min(0), rtol=0, atol=1e-4)
    np.testing.assert_allclose(high, samples.max(0), rtol=0, atol=1e-4)
    for z, found in ((least, low), (most, high)):
        assert ((z >= 0.0) & (z <= 1.0)).all()
        np.testing.assert_array_equal(value(c, z), found)


def motion(seed: int) -> Motion:
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 0.6, 3))])
    size = 10.0 ** random.uniform(-2.0, 0.5)
    start = UR5.initial_position[JOINTS]
    x, v, a = size * random.uniform(-1.0, 1.0, (3, 4, 3))
    x[0] = v[0] = a[0] = v[-1] = a[-1] = 0.0
    return Motion(NAMES, times, start + x, 2.0 * v, 5.0 * a, np.arange(4) + 2, "a.csv")


def found(given_: Motion, degree: str, scaling: float, approach: float = 0.0) -> dict:
    path = Trajectory(given_, degree, scaling, approach)
    path.start(UR5.initial_position[JOINTS], 0.0)
    return limits_exceeded(path, given_, UR5, JOINTS, scaling)


def sampled(given_: Motion, degree: str, scaling: float) -> set[tuple[str, str]]:
    """Joint and quantity that differences of dense samples find beyond a limit by 0.1 %."""
    path = Trajectory(given_, degree, scaling, 0.0)
    path.start(UR5.initial_position[JOINTS], 0.0)
    times = np.linspace(0.0, path.rests_after_s * (1.0 - 1e-9), 1201)
    x, v = np.zeros((2, len(times), 3))
    for k, time in enumerate(times.tolist()):
        path.at(time, x[k], v[k])
    step = times[1]
    begins, ends = (np.searchsorted(path.times_s[1:-1], t) for t in (times[:-1], times[1:]))
    a = (np.diff(v, axis=0) / step)[begins == ends]
    beyond = {
        "position": (x < UR5.lower[JOINTS] - 1e-3) | (x > UR5.upper[JOINTS] + 1e-3),
        "velocity": np.abs(v) > 1.001 * UR5.velocity[JOINTS],
        "acceleration": np.abs(a) > 1.001 * UR5.setpoint_acceleration_max[JOINTS],
    }
    return {(NAMES[i], what) for what, rows in beyond.items() for i in np.flatnonzero(rows.any(0))}


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), degree=st.sampled_from(DEGREES))
def test_it_finds_what_samples_find_and_says_how_much_slower_fits(seed, degree):
    given_ = motion(seed)
    seen = found(given_, degree, 1.0)
    told = {(each["joint"], each["what"]) for each in seen["exceeded"]}
    assert sampled(given_, degree, 1.0) <= told
    for each in seen["exceeded"]:
        assert abs(each["value"] - each["limit"]) > 0.0
        assert 0.0 <= each["time_s"] <= given_.times_s[-1] + 1e-12
    fits = seen["fits_with_time_scaling"]
    if fits is None:
        assert any(what == "position" for _, what in told)
        return
    assert bool(told) == (fits > 1.0)
    assert found(given_, degree, fits)["exceeded"] == []
    assert found(given_, degree, fits * 0.999 - 1e-4)["exceeded"] != []  # it is rounded up


def test_the_way_to_the_first_point_has_a_time_of_its_own():
    given_ = motion(3)
    given_.positions[:, 1] += 0.8
    seen = found(given_, "cubic", 3.0, 0.1)
    assert {each["approach"] for each in seen["exceeded"]} == {True}
    assert {each["joint"] for each in seen["exceeded"]} == {NAMES[1]}
    assert found(given_, "cubic", 3.0, seen["fits_with_approach_s"])["exceeded"] == []
    assert found(given_, "cubic", 3.0, seen["fits_with_approach_s"] * 0.999)["exceeded"] != []


def checked(folder: Path, text: str, *words: object) -> Done:
    """What `hoap3 trajectory check` says of this file for a UR5."""
    file = folder / "a.csv"
    file.write_bytes(text.encode())
    return inside("trajectory", "check", file, "--robot", "ur5", *words)


FAST = f"t,{NAMES[1]}\n0,1.6\n0.1,1.7\n0.2,1.2\n1.0,1.2\n"


@pytest.mark.parametrize(("scaling", "code"), [("1", 1), ("80", 0)])
def test_the_command_ends_with_1_where_a_limit_is_exceeded(scaling, code, tmp_path):
    done = checked(tmp_path, FAST, "--time-scaling", scaling, "--json")
    told = done.json()
    assert done.code == code
    assert bool(told["exceeded"]) == bool(code)
    if code:
        speed = next(each for each in told["exceeded"] if each["what"] == "velocity")
        assert (speed["joint"], speed["line"]) == (NAMES[1], 3)
        assert speed["value"] == pytest.approx(-5.0)
        assert 0.1 <= speed["time_s"] - told["approach_s"] <= 0.2


def test_points_in_space_are_told_with_their_speed(tmp_path):
    told = checked(tmp_path, "t,x,y,z\n0,0,0,0.3\n2,0.6,0.8,0.3\n", "--json").json()
    assert told["top_speed_m_s"] == pytest.approx(0.5)
    assert told["ranges_m"]["y"] == pytest.approx([0.0, 0.8])


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("t,x,y,z\n0,0.3,0,0.4\n1700000000,0.3,0.1,0.4\n", "1700000000"),
        ("t,x,y\n0,0.3,0\n1,0.3,0.1\n", "z"),
        (f"t,{NAMES[0]},{NAMES[0]}/velocity\n0,0,0\n1,0.1,0.01\n", "rest"),
    ],
)
def test_what_a_run_refuses_the_check_does(text, word, tmp_path):
    done = checked(tmp_path, text)
    assert done.code == 2
    assert word in done.stderr


def test_a_scaling_for_which_nobody_waits_is_refused(tmp_path):
    text = "t,x,y,z\n0,0.3,0,0.4\n1,0.3,0.1,0.4\n"
    done = checked(tmp_path, text, "--time-scaling", "1e9")
    assert done.code == 2
    assert "--time-scaling" in done.stderr


def test_of_a_motion_in_space_the_extremes_are_told(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t,x,y,z\n0,0.3,0,0.4\n1,0.3,0.1,0.4\n1.5,0.3,-0.1,0.5\n")
    told = look(str(file), "ur5", "linear", 1.0, 0.0)
    assert told["ranges_m"] == {"x": [0.3, 0.3], "y": [-0.1, 0.1], "z": [0.4, 0.5]}
    assert told["top_speed_m_s"] == pytest.approx(np.hypot(0.4, 0.2))


FORMATS = {
    "semicolons": ("t;elbow_joint\n0;1.6\n1;1.5\n", "commas"),
    "tabs": ("t\telbow_joint\n0\t1.6\n1\t1.5\n", "commas"),
    "blanks": ("t elbow_joint\n0 1.6\n1 1.5\n", "commas"),
    "bars": ("t|elbow_joint\n0|1.6\n1|1.5\n", "commas"),
    "decimal commas": ("t,elbow_joint\n0,0,1,6\n", "line 2"),
    "a comment first": ("# made by x\nt,elbow_joint\n0,1.6\n1,1.5\n", "#"),
    "a commented header": ("#t,elbow_joint\n0,1.6\n1,1.5\n", "#"),
    "a comment between": ("t,elbow_joint\n0,1.6\n// x\n1,1.5\n", "line 3"),
    "YAML": ("joint_trajectory:\n  joint_names: [elbow_joint]\n", "CSV"),
    "JSON": ('{"joint_names": ["elbow_joint"]}\n', "CSV"),
    "XML": ("<a/>\n", "CSV"),
    "time": ("time,elbow_joint\n0,1.6\n1,1.5\n", "t"),
    "timestamp": ("timestamp_ms,elbow_joint\n0,1.6\n1,1.5\n", "seconds"),
    "an export": ("log_time,tick,q.elbow_joint\n0,0,1.6\n1,1,1.5\n", "trajectory from"),
    "nanoseconds": ("t,elbow_joint\n17e17,1.6\n1700000001e9,1.5\n", "1e9"),
    "milliseconds": ("t,elbow_joint\n17e11,1.6\n1700000001e3,1.5\n", "1e3"),
    "a day in ms": ("t,elbow_joint\n0,1.6\n86400001,1.5\n", "1e3"),
    "a typing error": ("t,elbow_joit\n0,1.6\n1,1.5\n", "'elbow_joint'"),
    "a topic": ("t,/joint_states/elbow_joint/position\n0,1.6\n1,1.5\n", "'elbow_joint'"),
    "underscores": ("t,elbow_joint\n0,1.6\n1,1_0e-1\n", "'1_0e-1'"),
    "other digits": ("t,elbow_joint\n0,1.6\n1,١\n", "line 3"),
}  # fmt: skip


@pytest.mark.parametrize("case", FORMATS)
def test_another_format_is_refused_with_what_to_do(case, tmp_path):
    text, word = FORMATS[case]
    done = checked(tmp_path, text)
    assert done.code == 2
    assert word in done.stderr


def test_a_marked_file_is_read(tmp_path):
    assert checked(tmp_path, "\ufefft,elbow_joint\r\n0,1.6\r\n1,1.6\r\n").code == 0


def test_a_jump_at_the_start_is_found(tmp_path):
    text = "t,shoulder_pan_joint,elbow_joint\n0,1.0,1.6\n2,1.0,1.6\n"
    done = checked(tmp_path, text, "--json", "--approach", 0)
    (found,) = done.json()["exceeded"]
    assert done.code == 1
    assert found["joint"] == "shoulder_pan_joint"
    assert found["what"] == "jump of the position"
    assert found["unit"] == "rad"
    assert found["value"] == pytest.approx(1.0)
    fits = done.json()["fits_with_approach_s"]
    assert fits > 0.0
    assert checked(tmp_path, text, "--approach", fits).code == 0
    assert checked(tmp_path, text, "--approach", 0.99 * fits).code == 1


def test_units_are_named_where_limits_are_exceeded_and_where_steps_are_long(tmp_path):
    for text, code, word in (
        ("t,shoulder_pan_joint\n0,0\n1,90\n2,0\n", 1, "degrees"),
        ("t,shoulder_pan_joint\n0,0\n1,6\n2,0\n", 1, "degrees"),
        ("t,shoulder_pan_joint\n0,0\n1000,0.1\n2000,0\n", 0, "milliseconds"),
    ):
        done = checked(tmp_path, text, "--json")
        assert done.code == code
        assert any(word in hint for hint in done.json()["hints"])


def test_a_motion_that_is_a_little_too_fast_is_not_taken_for_degrees(tmp_path):
    text = "t,shoulder_pan_joint\n0,0\n0.3,1\n2,0\n"
    done = checked(tmp_path, text, "--approach", 0, "--json")
    assert done.code == 1
    assert done.json()["hints"] == []
