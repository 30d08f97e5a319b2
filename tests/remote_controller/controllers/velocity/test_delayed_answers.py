"""Controllers of velocities on a robot that applies answers some ticks later."""

from __future__ import annotations

import numpy as np
import pytest
from support.small_arm import arm

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import Setpoint, State
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.in_flight import InFlight
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.configs import load_controller_config
from hoap3.tools.services.simulate import simulate

DELAYS = [1, 3, 100]
SHORT = [1, 3]
LOST = 30


def run(d: int, controller: object = "qp12", lost: int | None = None):
    """Two fifths of a second; the answer to one tick may be lost."""

    def fate(answer: bytes) -> list[tuple[int, bytes]]:
        (tick,) = Setpoint.scalars(answer, "tick")
        return [] if tick == lost else [(200_000, answer)]

    return simulate({"robot": "hoap3", "delay_ticks": d}, controller, duration=0.4, fate=fate)


@pytest.mark.parametrize("d", SHORT)
@pytest.mark.parametrize("controller", ["qp12", "stable_qp_hoap3", "ghc_velocity"])
def test_the_motion_is_as_smooth_as_without_a_delay_and_certified(controller, d):
    at_once, later = run(0, controller), run(d, controller)
    certified = (STATUS["certified"], STATUS["at_target"])
    assert np.isin(later.setpoints["solver_status"], certified).all()
    sent, delayed = at_once.setpoints["values"], later.setpoints["values"]
    roughness = [np.abs(np.diff(values, 2, axis=0)).max() for values in (sent, delayed)]
    assert roughness[1] <= 1.2 * roughness[0]
    assert later.setpoints["v"][-1] < 1.1 * at_once.setpoints["v"][-1 - d]


@pytest.mark.parametrize("d", DELAYS)
def test_each_answer_goes_on_from_the_one_before(d):
    """The reference that is in force is that of d + 1 answers ago, bit by bit."""
    found = run(d)
    answers = found.setpoints["values"]
    applied = found.states["reference"][: len(answers)]
    assert np.array_equal(applied[1 + d :], answers[: -1 - d])
    assert (applied[: 1 + d] == applied[0]).all()


def test_computed_from_the_reference_it_is_the_same_motion_later():
    """Then nothing that the controller looks at is older than without a delay."""
    settings = {"controller": "qp12", "parameters": {"kinematics_from": "reference"}}
    at_once, later = run(0, settings), run(3, settings)
    assert at_once.setpoints["values"].tobytes() == later.setpoints["values"].tobytes()


@pytest.mark.parametrize("d", SHORT)
def test_what_was_not_foreseen_is_not_certified(d):
    found = run(d, lost=LOST)
    status = found.setpoints["solver_status"]
    ticks = found.setpoints["tick"][status == STATUS["uncertified"]]
    assert ticks.tolist() == [LOST + 1 + d]
    values = found.setpoints["values"]
    undisturbed = run(d).setpoints["values"]
    assert values == pytest.approx(undisturbed, abs=1e-6)


@pytest.mark.parametrize("d", SHORT)
@pytest.mark.parametrize("lost", [set(), {20}, {20, 21, 25}, set(range(20, 29))])
def test_what_is_foreseen_is_what_a_robot_with_these_limits_does(d, lost):
    """Answers ask for three times the speed limit, and do not run away from the robot."""
    robot = arm(delay_ticks=d)
    reach = robot.velocity * robot.period_s
    flight, state, target = InFlight(robot), State(3), np.array(robot.initial_position)
    state.mode, state.epoch = State.ACTIVE, 1
    state.reference[:] = target
    sent: dict[int, np.ndarray] = {}
    foreseen: dict[int, np.ndarray] = {}
    for tick in range(10, 60):
        state.tick, state.epoch_from_tick = tick, 10
        if tick - 1 - d in sent and tick - 1 - d not in lost:
            target = sent[tick - 1 - d]
            state.reference[:] += np.clip(target - state.reference, -reach, reach)
        ahead = flight.ahead(state)
        assert flight.foreseen == (tick - d < 10 or (foreseen[tick] == state.reference).all())
        if not lost:
            assert flight.foreseen or np.allclose(
                foreseen[tick], state.reference, rtol=0, atol=1e-12
            )
        if flight.foreseen and not lost:
            assert (np.abs(ahead.reference - state.reference) <= (d + 1e-9) * reach).all()
        sent[tick] = ahead.reference + 3.0 * reach * np.array([1.0, -1.0, 0.2])
        foreseen[tick + d] = ahead.reference.copy()
        flight.sent(tick, sent[tick])
        assert (np.abs(sent[tick] - state.reference) <= (d + 3 + 1e-9) * reach).all()


@pytest.mark.parametrize("d", [0, 3])
def test_a_replay_is_the_same(d):
    found = run(d, lost=LOST)
    assert replay_records(found.records, load_controller_config("qp12")[0]).identical


def test_what_reckons_without_a_delay_is_refused():
    measured = {"controller": "qp12", "parameters": {"integrate_from": "measured"}}
    with pytest.raises(DescriptionError, match=r"'hoap3'.* 2 "):
        run(2, measured)
    with pytest.raises(DescriptionError, match="Controller"):
        run(2, "joint_acceleration")
