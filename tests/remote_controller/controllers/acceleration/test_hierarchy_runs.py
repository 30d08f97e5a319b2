"""Hierarchies in lockstep: errors, bounds, force, priorities that change."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_runs import content, made, robot, state_of

from hoap3.remote_controller.controllers.acceleration.problem import CONDITIONS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.analysis.certificates import CertificateCount, in_a_line
from hoap3.tools.services.simulate import Simulation, simulate

T = 1e-3


def column(done: Simulation, name: str) -> np.ndarray:
    return done.setpoints["extra"][:, done.controller.extra_names.index(name)]


@pytest.mark.slow
def test_the_highest_task_comes_to_its_target_though_others_contradict_it():
    order = {"order": ["hand", "elbow", "posture"]}
    done = simulate("lwr_weightless", content("ghc", priorities=order), 6.5)
    assert column(done, "error_hand")[0] > 0.4
    assert column(done, "error_hand")[-1] < 1e-4
    assert column(done, "error_elbow")[-1] == pytest.approx(0.46, rel=0.15)  # Table 1
    assert column(done, "error_posture")[-1] == pytest.approx(1.8, rel=0.15)
    assert (done.setpoints["solver_status"] == STATUS["certified"]).all()
    assert (done.setpoints["fallback"] == 0).all()


def test_torques_speeds_and_positions_stay_within_bounds():
    limits = {"kind": "viability", "torque_max": [1.5], "speed_max": [1.2]}
    eight = {"kind": "lemniscate", "center_m": [0.25, -0.4, 0.7], "half_width_m": 0.1}
    eight |= {"period_s": 6.283185307179586, "approach_s": 1.0}
    tasks = content("ghc")["parameters"]["tasks"]
    tasks[0] |= {"kp": 100.0}
    tasks[0]["parameters"] |= {"target": eight}
    priorities = {
        "order": ["hand", "elbow", "posture"],
        "timeline": [{"at_s": 1.5, "order": ["elbow", "hand"], "over_s": 0.05}],
    }
    changes = {"tasks": tasks, "bounds": limits, "priorities": priorities}
    done = simulate("lwr_weightless", content("ghc", **changes), 3.0)
    torques, states = done.setpoints["values"], done.states
    assert np.abs(torques).max() <= 1.5 + 1e-6
    assert np.abs(torques).max() == pytest.approx(1.5)  # and they did hold something back
    assert np.abs(states["dq"]).max() <= 1.2 + 1e-6
    assert (states["q"] >= robot().lower).all()
    assert (states["q"] <= robot().upper).all()
    assert (done.setpoints["fallback"] == 0).all()


def test_a_moving_target_is_followed_with_its_acceleration():
    eight = {"kind": "lemniscate", "center_m": [0.2, -0.4, 0.7], "half_width_m": 0.1}
    eight |= {"period_s": 3.0, "approach_s": 1.0}
    tasks = content("ghc")["parameters"]["tasks"]
    tasks[0] |= {"kp": 100.0}
    tasks[0]["parameters"] |= {"target": eight}
    order = {"order": ["hand", "elbow", "posture"]}
    changes = {"tasks": tasks, "priorities": order, "regularise": "none", "w_r": 1e-6}
    done = simulate("lwr_weightless", content("ghc", **changes), 3.0)
    assert column(done, "error_hand")[1500:].max() < 1e-4  # without, 4e-3


@pytest.mark.slow
def test_the_hand_keeps_its_force_and_its_place_on_the_table():
    change = {"at_s": 0.5, "order": ["hand", "elbow", "posture"], "over_s": 0.5}
    priorities = {"order": ["elbow", "hand", "posture"], "timeline": [change]}
    done = simulate("lwr_with_table", content("ghc_force", priorities=priorities), 4.0)
    force, place = column(done, "force_hand"), column(done, "error_hand")
    touched = np.flatnonzero(force > 0.5)
    assert 0 < touched[0] < 2000
    np.testing.assert_allclose(force[-500:], 10.0, rtol=0.005)
    assert place[-500:].max() < 1e-3  # what is left of it, which is horizontal
    said = done.setpoints["solver_status"]
    assert (said[touched[0] :] == STATUS["uncertified"]).all()  # nobody knows the table
    assert (done.setpoints["fallback"] == 0).all()


def test_a_transition_makes_torques_move_smoothly():
    """Elbow and hand change places; at once the torques jump by newton metres."""
    steps = {}
    for over in (0.0, 0.4):
        change = {"at_s": 0.8, "order": ["elbow", "hand"], "over_s": over}
        priorities = {"order": ["hand", "elbow", "posture"], "timeline": [change]}
        done = simulate("lwr_weightless", content("ghc", priorities=priorities), 1.5)
        torques = np.abs(np.diff(done.setpoints["values"], axis=0)).max(axis=1)
        steps[over] = torques[790:].max()
        alpha = column(done, "alpha_elbow_hand")
        assert alpha[799] == 1.0
        assert alpha[-1] == 0.0
        moving = done.setpoints["solver_status"] == STATUS["uncertified"]
        count = 1 if over == 0.0 else round(over / T)
        assert np.flatnonzero(moving).size == count
        if over:
            expected = 0.5 + 0.5 * np.cos(np.pi * (np.arange(799, 1201) - 800) * T / over)
            np.testing.assert_allclose(alpha[800:1201], expected[1:], atol=1e-9)
    assert steps[0.0] > 1.0
    assert steps[0.4] < 0.02 * steps[0.0]


@pytest.mark.parametrize("smoothing", [0.05, 0.2])
def test_a_smoothed_transition_begins_without_a_jump(smoothing):
    """Hand and elbow, a level that the posture is kept out of, conflict; the elbow leaves it."""
    out = {"at_s": 0.8, "over_s": 5.0, "remove": "elbow"}
    priorities = {"order": ["hand", "elbow", "posture"], "timeline": [out]}
    settings = content("ghc", priorities=priorities, smoothing=smoothing)
    done = simulate("lwr_weightless", settings, 0.82)
    torques = np.abs(np.diff(done.setpoints["values"], axis=0)).max(axis=1)
    assert torques[795:815].max() < 0.02


def test_a_change_that_is_asked_for_is_as_one_of_the_timeline():
    change = {"order": ["elbow", "hand"], "over_s": 0.05}
    start = {"order": ["hand", "elbow", "posture"]}
    planned = made("ghc", priorities={**start, "timeline": [{**change, "at_s": 0.1}]})
    asked = made("ghc", priorities=start)
    q = planned.description.postures["bent"]
    states = [state_of(each, q, np.zeros(7)) for each in (planned, asked)]
    for tick in range(200):
        answers = []
        for each, state in zip((planned, asked), states, strict=True):
            state.tick = tick
            answers.append(each.step(state).values.copy())
        np.testing.assert_array_equal(*answers)
        if tick == 99:
            asked.change(change)
    assert asked.importance.alpha[0, 1] == 1.0


def test_states_that_are_missed_do_not_delay_the_priorities():
    change = {"order": ["elbow", "hand"], "over_s": 0.05, "at_s": 0.1}
    priorities = {"order": ["hand", "elbow", "posture"], "timeline": [change]}
    controller = made("ghc", priorities=priorities)
    state = state_of(controller, controller.description.initial_position, np.zeros(7))
    controller.step(state)
    state.tick = 125
    command = controller.step(state)
    alpha = command.extra[controller.extra_names.index("alpha_hand_elbow")]
    assert alpha == pytest.approx(0.5)


def test_an_arm_whose_tasks_are_removed_comes_to_rest():
    """Without a brake it coasts into the ends of its ranges, and torques jump there."""
    speeds = {}
    for damping in (0.0, 10.0):
        out = {"at_s": 0.4, "remove": ["posture", "elbow"], "over_s": 0.4}
        priorities = {"order": ["hand", "elbow", "posture"], "timeline": [out]}
        settings = content("ghc", priorities=priorities, null_damping_per_s=damping)
        done = simulate("lwr_weightless", settings, 1.8)
        ticks = len(done.setpoints)
        torques = np.abs(np.diff(done.setpoints["values"], axis=0)).max(axis=1)
        speeds[damping] = np.abs(done.states["dq"][ticks - 1]).max()
        assert (done.setpoints["fallback"] == 0).all()
        if damping:
            assert torques[380:].max() < 0.1
    assert speeds[10.0] < 0.1 < speeds[0.0]


def test_weights_change_smoothly_and_by_request():
    controller = made("weighted")
    state = state_of(controller, controller.description.initial_position, np.zeros(7))
    column = controller.extra_names.index("weight_hand")
    seen = []
    for tick in range(40):
        state.tick = tick
        seen.append(controller.step(state).extra[column])
        if tick == 9:
            controller.change({"weights": {"hand": 0.0}, "over_s": 0.02})
    assert seen[:11] == [1.0] * 11
    assert seen[20] == pytest.approx(0.5)
    assert seen[30:] == [0.0] * 10


def test_the_summary_of_a_baseline_says_that_nothing_is_proved():
    """Bounds that it reaches, here all the time, are not why."""
    slow = {"acceleration_max": [0.5]}
    settings, count = content("weighted", bounds=slow), CertificateCount()
    done = simulate("lwr_weightless", settings, 0.05)
    for record in done.records:
        count.add(record)
    held = 1 << CONDITIONS.index("held by bounds of joints")
    assert done.controller.present & held
    found = count.figures()
    assert (found["certified"], found["uncertified"]) == (0, found["n"])
    assert "held by" not in in_a_line(found)


def test_thirty_two_joints_keep_the_order_of_five_tasks():
    done = simulate("humanoid32_torque", content("ghc_humanoid", w_r=1e-6), 1.5)
    assert column(done, "error_head").max() < 1e-4
    assert column(done, "error_left_foot")[-1] < 0.2
    assert (done.setpoints["solver_status"] == STATUS["certified"]).all()
