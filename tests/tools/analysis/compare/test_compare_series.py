"""What is read from States and answers: u, and joints that are sent beyond a limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.log_samples import describe

from hoap3.protocol.messages import Setpoint, State
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.analysis.compare.figures import read_series
from hoap3.tools.analysis.compare.loops import Answers
from hoap3.tools.services.simulate import table_of

ROBOT = describe(2)  # usable ±1.9 rad, 5 rad/s, 1 ms
PLACES = st.sampled_from([0.0, 1.899, 1.9, 1.9 + 1e-6, 1.95, -1.9, -1.9 - 1e-6, -1.95])
STEPS = st.sampled_from([0.0, 1e-6, -1e-6, 0.005, -0.005, 0.00501, -0.00501, 0.01])


def answers(before, steps, *, closed_loop=False, command=Setpoint.POSITION, measured=None):
    """Answers that go from applied references by steps, (k, 2) each."""
    state, setpoint = State(2), Setpoint(2, 0)
    states, setpoints = [], []
    for tick, (start, step) in enumerate(zip(before, steps, strict=True)):
        state.tick, state.stamp_intended = tick, 5_000 + tick * 1_000_000
        state.reference[:] = start
        state.q[:] = start if measured is None else measured
        setpoint.command, setpoint.v = command, 2.0
        setpoint.values[:] = np.add(start, step)
        states.append(state.dump())
        setpoints.append(setpoint.dump())
    return Answers(
        description=ROBOT,
        controller=None,
        states=table_of(states, State),
        setpoints=table_of(setpoints, Setpoint),
        asked=states,
        closed_loop=closed_loop,
    )


@settings(max_examples=60)
@given(st.lists(st.tuples(PLACES, PLACES, STEPS, STEPS), min_size=1, max_size=6))
def test_joints_beyond_a_limit_are_counted_unless_they_come_back(rows):
    before, steps = [row[:2] for row in rows], [row[2:] for row in rows]
    series = read_series(answers(before, steps), {})
    for tick, (starts, moves) in enumerate(zip(before, steps, strict=True)):
        beyond = fast = 0
        for start, move in zip(starts, moves, strict=True):
            after = start + move
            outside = abs(after) > 1.9 + 1e-9
            further = abs(after) > abs(start) + 1e-9
            beyond += outside and further
            fast += abs(move) > 0.005 + 1e-11
        assert series.position[tick] == beyond
        assert series.speed[tick] == fast
    assert np.allclose(series.inputs, np.array(steps) / 0.001, atol=1e-9)
    assert np.allclose(series.time_s, 0.001 * np.arange(len(rows)))


def test_u_counts_from_where_the_controller_integrates():
    found = answers([[0.5, 0.5]], [[0.001, 0.002]], measured=[0.5, 0.501])
    assert read_series(found, {}).inputs[0] == pytest.approx([1.0, 2.0])
    measured = read_series(found, {"integrate_from": "measured"})
    assert measured.inputs[0] == pytest.approx([1.0, 1.0])


def test_a_torque_is_no_speed_and_whether_it_breaks_a_limit_is_not_known():
    series = read_series(answers([[0.0, 0.0]], [[9.0, -9.0]], command=Setpoint.TORQUE), {})
    assert series.unit == "N m"
    assert series.active is None
    assert series.switched is None
    assert (series.position, series.speed) == (None, None)


def test_only_a_closed_loop_has_a_path():
    rows = [[0.0, 0.0], [0.3, 0.4], [0.3, 0.4]], np.zeros((3, 2))
    closed = read_series(answers(*rows, closed_loop=True), {})
    assert np.array_equal(closed.reference, rows[0])
    assert closed.com_m.shape == (3, 3)
    assert not read_series(answers(*rows), {}).com_m.size
    assert not read_series(answers(*rows), {}).reference.size


def test_the_certificate_is_taken_as_it_is():
    series = read_series(answers([[0.0, 0.0]], [[0.0, 0.0]]), {})
    assert series.status[0] == STATUS["certified"]
    assert series.error[0] == 2.0
