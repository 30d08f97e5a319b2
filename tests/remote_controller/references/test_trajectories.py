"""Trajectories: they are scipy's splines, begin where the robot is, and end at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.references.target import Target
from hoap3.remote_controller.references.trajectories.motion_file import Motion, read_motion
from hoap3.remote_controller.references.trajectories.trajectory import Trajectory, degree_of

DEGREES = ("linear", "cubic", "quintic")
NAMES = ("a", "b", "c")


def motion(seed: int, points: int, parts: int, first: float = 0.0) -> Motion:
    """Positions, and as many of velocities and accelerations as `parts` says beyond one."""
    random = np.random.default_rng(seed)
    times = first + np.concatenate([[0.0], np.cumsum(random.uniform(0.05, 1.0, points - 1))])
    given = [random.normal(size=(points, len(NAMES))) for _ in range(3)]
    lines = np.arange(points) + 2
    return Motion(NAMES, times, *given[:parts], *[None] * (3 - parts), lines, "a.csv")


def at(target: Target, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    out = np.full(target.dimension, np.nan), np.full(target.dimension, np.nan)
    target.at(time_s, *out)
    return out


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    points=st.integers(2, 7),
    parts=st.integers(1, 3),
    degree=st.sampled_from(DEGREES),
    scaling=st.floats(0.2, 5.0),
)
def test_it_is_the_spline_of_scipy(seed, points, parts, degree, scaling):
    given = motion(seed, points, parts)
    times, x = given.times_s * scaling, given.positions
    free = CubicSpline(times, x, bc_type="clamped")(times, 1)
    v = free if given.velocities is None else given.velocities / scaling
    a = np.zeros_like(x) if given.accelerations is None else given.accelerations / scaling**2
    peer = {
        "linear": lambda: BPoly.from_derivatives(times, x[:, None]),
        "cubic": lambda: CubicHermiteSpline(times, x, v),
        "quintic": lambda: BPoly.from_derivatives(times, np.stack([x, v, a], 1)),
    }[degree]()
    target = Trajectory(given, degree, scaling)
    target.start(x[0], 3.0)

    size = max(1.0, np.abs(v).max(), np.abs(x).max())
    for time in np.random.default_rng(seed).uniform(0.0, times[-1], 20):
        position, velocity = at(target, 3.0 + time)
        np.testing.assert_allclose(position, peer(time), rtol=0, atol=1e-9)
        np.testing.assert_allclose(velocity, peer.derivative()(time), rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_the_degree_is_what_the_points_carry(parts):
    assert degree_of(motion(0, 3, parts)) == DEGREES[parts - 1]


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    degree=st.sampled_from(DEGREES),
    first=st.sampled_from([0.0, 0.6]),
)
def test_it_leads_from_where_the_robot_is_to_the_points_and_stays_at_the_last(seed, degree, first):
    given, approach = motion(seed, 4, 3, first), 0.7
    present = np.array([0.3, -0.2, 0.9])
    target = Trajectory(given, degree, 2.0, approach)
    target.start(present, 5.0)
    begin = 5.0 + (approach if first == 0.0 else 0.0)

    position, velocity = at(target, 5.0)
    np.testing.assert_allclose(position, present, rtol=0, atol=1e-15)
    if degree != "linear" or first == 0.0:
        np.testing.assert_array_equal(velocity, 0.0)
    for time, point in zip(given.times_s, given.positions, strict=True):
        np.testing.assert_allclose(at(target, begin + 2.0 * time)[0], point, rtol=0, atol=1e-12)
    end = begin + 2.0 * float(given.times_s[-1])
    assert target.rests_after_s == pytest.approx(end - 5.0, abs=1e-12)
    np.testing.assert_array_equal(at(target, end + 0.1)[0], given.positions[-1])
    np.testing.assert_array_equal(at(target, end + 0.1)[1], 0.0)


def test_components_without_a_column_stay_where_they_are():
    target = Trajectory(motion(1, 3, 2), "cubic", 1.0, 0.5, [3, 0, 4], 5)
    present = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    for begin in (0.0, 9.0):
        target.start(present, begin)
        for time in np.linspace(0.0, target.rests_after_s + 0.2, 40):
            position, velocity = at(target, begin + time)
            np.testing.assert_array_equal(position[[1, 2]], present[[1, 2]])
            np.testing.assert_array_equal(velocity[[1, 2]], 0.0)
        np.testing.assert_array_equal(position[[3, 0, 4]], motion(1, 3, 2).positions[-1])
        present = present + 1.0


def test_what_gives_up_stays_until_it_starts_again():
    target = Trajectory(motion(2, 3, 2), "cubic", 1.0, 0.5)
    target.start(np.zeros(3), 0.0)
    before = at(target, 0.8)
    target.stay(np.array([1.0, 2.0, 3.0]))
    for time in (0.8, 1.0, 50.0):
        np.testing.assert_array_equal(at(target, time), [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    target.start(np.zeros(3), 10.0)
    np.testing.assert_allclose(at(target, 10.8), before, rtol=0, atol=1e-13)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), turns=st.floats(0.1, 3.0))
def test_orientations_become_rotation_vectors_without_a_jump(seed, turns):
    """A turn about one axis, further than a whole one; either sign of a quaternion is the same."""
    random = np.random.default_rng(seed)
    axis = random.normal(size=3)
    angles = np.linspace(0.1, 0.1 + turns * 2.0 * np.pi, 1 + int(8 * turns) + 1)
    vectors = angles[:, None] * axis / np.linalg.norm(axis)
    quaternions = Rotation.from_rotvec(vectors).as_quat()
    quaternions *= random.choice([-1.0, 1.0], size=(len(angles), 1))
    rows = [f"{k},0,0,0," + ",".join(map(repr, q)) for k, q in enumerate(quaternions.tolist())]
    found = read_motion("\n".join(["t,x,y,z,qx,qy,qz,qw", *rows]), "a", "xyz", turns=True)
    assert found.names == ("x", "y", "z", "rx", "ry", "rz")
    np.testing.assert_allclose(found.positions[:, 3:], vectors, rtol=0, atol=1e-9)
