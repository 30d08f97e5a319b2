"""Soles of a free base: outlines, supports, and which of them carry."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.remote_controller.problems import soles
from hoap3.remote_controller.problems.oracles.free_robot_oracle import FreeRobot
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.robot_emulator.robots import load

SQUARE = 0.05 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


@pytest.mark.parametrize(("margin_m", "friction"), [(0.06, 0.5), (0.0, 0.0)])
def test_a_sole_of_which_nothing_is_left_is_unverifiable(margin_m, friction):
    with pytest.raises(UnverifiableError, match="'foot'"):
        soles.Sole.of("foot", SQUARE, margin_m, friction)


def test_the_support_of_vertical_soles_is_a_segment_or_a_point():
    start, end = np.array([0.1, 0.2]), np.array([0.4, 0.6])
    line = start + np.array([[0.3], [1.0], [0.0], [1.0], [0.6]]) * (end - start)
    across = np.array([-0.8, 0.6])

    for share, nearest in ((0.5, 0.5), (-0.2, 0.0), (1.3, 1.0)):
        point = start + share * (end - start) + 0.1 * across
        found = soles.nearest_within(line, point)
        assert found == pytest.approx(start + nearest * (end - start), abs=1e-15)
    assert soles.nearest_within(np.tile(end, (4, 1)), start) == pytest.approx(end, abs=0.0)


@pytest.mark.parametrize(
    ("timers", "lost_after_s", "options"),
    [
        ([0.0, 0.001], 0.0, [[True, False]]),
        ([0.0, 0.002], 0.001, [[True, False]]),
        ([0.001, 0.001 + 1e-15], 0.001, [[True, True], [True, False], [False, True], [False] * 2]),
    ],
)
def test_only_a_time_at_its_limit_leaves_open_whether_a_sole_carries(timers, lost_after_s, options):
    found = soles.loaded_options(np.array(timers), lost_after_s, 1e-9)

    assert [each.tolist() for each in found] == options


def test_more_soles_than_have_few_options_are_unverifiable():
    robot = load("hoap3")
    frames = robot.frames[: soles.MOST_SOLES + 1]
    feet = tuple(robot.soles[0].model_copy(update={"frame": frame}) for frame in frames)
    many = robot.model_copy(update={"soles": feet})

    with pytest.raises(UnverifiableError, match="soles"):
        soles.Soles(FreeRobot(robot), soles.DEFAULTS, many)
