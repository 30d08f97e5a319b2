"""The general controller: what it does where its constraints and its task disagree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from stable_runs import run, settings

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.protocol.messages import State
from hoap3.remote_controller.config import (
    ControllerConfig,
    available_configs,
    build,
    check_parameters,
    read_config,
)
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp
from hoap3.robot_emulator.robots import load

STABLE = [name for name in available_configs() if read_config(name)[0]["controller"] == "stable_qp"]
OUTSIDE = (0.01, 0.07, 0.2869)  # m: beyond the left edge of the right sole
SPEED = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.6}}
RANGE = {"constraint": "joint_position", "parameters": {}}


@pytest.mark.parametrize("case", STABLE)
@pytest.mark.parametrize("seconds", [2.0, pytest.param(20.0, marks=pytest.mark.long)])
def test_every_tick_of_a_shipped_config_is_certified_and_v_falls_as_promised(case, seconds):
    """V_{k+1} ≤ V_k − T·ρΨ + c·T², c = 2·max|de/dt|²: e = Δx − w·T moves with target and robot."""
    found = run(case, seconds).setpoints
    assert set(found["solver_status"]) <= {0, 1}
    assert (found["margin"] >= -1e-9).all()
    v, required = found["v"], found["v_rate_required"]
    e, drift = np.sqrt(2.0 * v), np.abs(found["extra"][:, 1])
    fastest = max(np.abs(np.diff(e)).max() / 1e-3, (drift[e > 0] / e[e > 0]).max(initial=0.0), 0.02)
    left = v[:-1] + 1e-3 * required[:-1] + 2.0 * fastest**2 * 1e-6
    away = e[:-1] > 1e-9
    assert (v[1:][away] <= left[away]).all()
    if case == "com_circulation":  # along the curve each step leaves it by (v·T)²/2r
        assert (e[5000:] <= 3e-5).all()  # m
    elif not drift.any():  # V has nothing to follow: it never rises at all
        assert (np.diff(v)[away] <= 4e-16 * v[:-1][away]).all()


@pytest.mark.slow
def test_the_com_stops_at_the_edge_of_its_support():
    found = run(settings(target_m=OUTSIDE, objective={"kind": "qp12", "gamma": 0.0}), 4.0)
    p = found.setpoints
    assert set(found.statuses) == {"certified"}
    assert (p["margin"] >= -1e-9).all()
    assert p["rho"][0] == 1.0
    assert 0.0 <= p["rho"][-1] < 1e-6
    edge = 0.0365 - 0.005  # half the sole less the margin of the config
    assert np.sqrt(2.0 * p["v"][-1]) == pytest.approx(OUTSIDE[1] - edge, abs=2e-5)
    assert np.abs(found.speeds[-100:]).max() < 1e-3
    assert found.began["held by support_polygon"] == found.began["slowed"] == 1


@pytest.mark.slow
def test_the_largest_share_races_where_a_damped_one_rests():
    content = settings(
        target_m=OUTSIDE,
        objective={"kind": "qp12", "gamma": 0.0},
        psi={"form": "one"},
    )
    damped = run(content, 1.5)
    content["parameters"]["rho"] = "largest"
    largest = run(content, 1.5)
    assert np.abs(damped.speeds[-100:]).max() < 0.01
    assert np.abs(largest.speeds[-100:]).max() > 0.3
    assert (np.diff(damped.setpoints["v"]) <= 1e-15).all()


def test_v_falls_no_further_is_said_and_the_robot_is_still():
    still = {"limit_rad_s": 0.6, "joints_rad_s": dict.fromkeys(load("hoap3").joint_names, 0.0)}
    found = run(settings(constraints=[{"constraint": "joint_velocity", "parameters": still}]))
    assert found.began["stationary"] == found.began["held by bounds of joints"] == 1
    assert set(found.statuses) == {"certified"}
    assert (found.setpoints["rho"] == 0.0).all()
    assert not found.speeds.any()


def test_constraints_that_contradict_each_other_leave_the_robot_still():
    stuck = {"joints_rad_s": {"r_elbow": 0.0}}
    moving = {"speed": 0.1, "joints": {"r_elbow": 1.0}, "tolerance": 0.99}
    found = run(
        settings(
            constraints=[
                {"constraint": "joint_velocity", "parameters": stuck},
                {"constraint": "minimum_speed", "parameters": moving},
            ]
        )
    )
    assert found.began["infeasible_constraints"] == 1
    assert set(found.statuses) == {"infeasible"}
    assert not found.speeds.any()


@pytest.mark.parametrize("constraint", ["viability", "joint_acceleration"])
def test_a_curve_gathers_speed_with_most_of_what_joints_can(constraint):
    """At rest ζ = 0.2 rad/s is out of reach: a period of 1 ms changes a speed by 0.01 rad/s."""
    wish = {"joints": ["r_elbow", "l_elbow"], "radii_rad": [0.1, 0.1]}
    task = {"task": "joint_curve", "parameters": {"curve_parameters": wish, "speed_rad_s": 0.2}}
    gentle = {"constraint": constraint, "parameters": {"limit_rad_s2": 10.0}}
    found = run(settings(task=task, constraints=[gentle]), 0.1)
    fastest = np.abs(found.speeds).max(axis=1)
    np.testing.assert_allclose(fastest[:20], 0.008 * np.arange(1, 21), rtol=0.01)
    assert fastest[30] == pytest.approx(0.2, rel=0.01)
    assert set(found.statuses) == {"certified"}
    assert found.setpoints["v"].max() < 1e-10  # it began on the curve
    assert found.began["slowed"]


def test_a_curve_is_kept_where_its_speed_is_never_to_be_had():
    wish = {"joints": ["r_elbow", "l_elbow"], "radii_rad": [0.1, 0.1]}
    task = {"task": "joint_curve", "parameters": {"curve_parameters": wish, "speed_rad_s": 0.2}}
    slow = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.05}}
    found = run(settings(task=task, constraints=[slow]), 1.0)
    fastest = np.abs(found.speeds).max(axis=1)[:990]  # at the end it stops
    assert (fastest > 0.02).all()
    assert (fastest < 0.05 * (1 + 1e-9)).all()
    assert found.setpoints["v"].max() < 1e-8
    assert "infeasible" not in found.statuses


@pytest.mark.slow
def test_a_curve_is_kept_where_its_speed_is_only_just_to_be_had():
    wish = {"joints": ["r_elbow", "l_elbow"], "radii_rad": [0.1, 0.1]}
    task = {"task": "joint_curve", "parameters": {"curve_parameters": wish, "speed_rad_s": 0.2}}
    slow = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.16}}
    found = run(settings(task=task, constraints=[slow]), 2.5)
    assert set(found.statuses) == {"certified"}
    assert found.setpoints["v"].max() < 1e-8
    assert found.began["slowed"] >= 2
    assert found.began["held by bounds of joints"] >= 2


@pytest.mark.parametrize("rho", ["damped", "largest"])
def test_a_target_that_is_too_fast_leaves_rho_below_zero(rho):
    target = {"kind": "circle", "center_m": [0.0, 0.03, 0.28], "radius_m": 0.03, "period_s": 0.1}
    task = {"task": "com", "parameters": {"frame": "r_sole", "target": target | {"approach_s": 0}}}
    slow = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.05}}
    found = run(settings(task=task, constraints=[slow], rho=rho))
    p = found.setpoints
    behind = p["rho"] < 0.0
    assert behind.any()
    assert (p["solver_status"][behind] == 2).all()
    assert found.began["cannot_descend"] >= 1
    assert np.abs(found.speeds).max() <= 0.05 * (1 + 1e-9)


def test_a_function_that_no_joint_can_change_holds_the_command():
    found = run(settings(task={"task": "flat_functions:Clock"}, constraints=[]))
    assert found.began["zero_gradient"] == 1
    assert set(found.statuses) == {"infeasible"}
    assert not found.speeds.any()


def test_a_start_outside_is_named_counted_and_led_back():
    plane = {"frame": "r_forearm", "normal": [0.0, 0.0, 1.0], "offset_m": 0.302}  # it is at 0.3009
    found = run(
        settings(constraints=[SPEED, RANGE, {"constraint": "half_space", "parameters": plane}]), 3.0
    )
    margin = found.setpoints["margin"]
    assert margin[0] < -5e-4
    assert found.began["half_space: started_outside"] == 1
    assert found.setpoints["solver_status"][0] == 2
    assert margin[-1] > -1e-6
    assert np.abs(found.speeds).max() <= 0.6 * (1 + 1e-9)


def test_a_state_that_is_not_finite_spoils_no_later_one():
    """Also where it is the one that the task should begin with."""
    description = load("hoap3")
    config = parse(ControllerConfig, settings("com_tracking"), "mine.yaml")
    spoilt, clean = (build(config, description, "mine.yaml") for _ in range(2))
    state = State(description.n, 6 * len(description.wrench_sensors))
    state.mode = State.ACTIVE

    def at(tick: int, q: np.ndarray | float) -> State:
        state.tick = tick
        state.q[:] = state.reference[:] = q
        return state

    initial = np.array(description.initial_position)
    spoilt.reset(at(5, np.nan), None)
    assert np.isnan(spoilt.step(at(5, np.nan)).values).all()
    clean.reset(at(6, initial), None)
    for tick in range(6, 300):
        if tick == 100:  # and in the midst of the motion
            spoilt.step(at(tick, np.nan))
        expected = clean.step(at(tick, initial)).values.copy()
        np.testing.assert_array_equal(spoilt.step(at(tick, initial)).values, expected)


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["forward", "backward"])
@pytest.mark.parametrize("kind", ["qp12", "least_squares"])
def test_it_circulates_in_the_direction_that_was_asked(direction, kind):
    content = settings("com_circulation", objective={"kind": kind})
    content["parameters"]["task"]["parameters"]["direction"] = direction
    found = run(content, 3.0)
    assert set(found.statuses) == {"certified"}
    description = load("hoap3")
    kinematics = Kinematics(description)
    sole, J, path = kinematics.frame_id("r_sole"), np.zeros((3, description.n)), []
    for q in found.simulation.states["reference"][-800::20]:
        kinematics.update(q.copy())
        path.append(np.zeros(3))
        kinematics.com(sole, path[-1], J)
    x, y = (np.array(path)[:, :2] - (0.0, 0.02)).T
    turned = x[:-1] * y[1:] - y[:-1] * x[1:]
    assert ((turned > 0.0) == (direction == "forward")).all()
    lengths = np.linalg.norm(np.diff(np.array(path), axis=0), axis=1) / 0.02
    assert np.median(lengths) == pytest.approx(0.01, rel=0.02)


def test_v_never_rises_with_remark_1():
    found = run(
        settings(lyapunov="descent", objective={"kind": "least_squares", "gain_per_s": 2.0}), 2.0
    )
    v = found.setpoints["v"]
    assert (np.diff(v) <= 4e-16 * v[:-1]).all()
    assert v[-1] < 0.01 * v[0]
    assert "slowed" not in found.began


@pytest.mark.parametrize(("p", "joints"), [(0.5, 1), (1, 1), (1.5, 20), (2, 20), ("inf", 20)])
def test_every_norm_without_constraints_gives_the_asked_fall(p, joints):
    p = run(settings(objective={"kind": "lp", "p": p}, constraints=[]), 0.2).setpoints
    np.testing.assert_allclose(p["v_rate_predicted"], -p["extra"][:, 0], rtol=1e-9)
    np.testing.assert_array_equal(p["rho"], 1.0)
    assert (p["kkt_residual"] <= 1e-9).all()
    moving = np.median(p["active_joints"])
    assert moving == 1 if joints == 1 else moving > 5


@pytest.mark.parametrize("p", [1, 2, "inf"])
@pytest.mark.parametrize("rho", ["damped", "largest"])
def test_norms_keep_constraints(p, rho):
    polygon = {"constraint": "support_polygon", "parameters": {"margin_m": 0.005}}
    found = run(
        settings(
            target_m=OUTSIDE,
            objective={"kind": "lp", "p": p},
            constraints=[SPEED, RANGE, polygon],
            rho=rho,
        ),
        0.6,
    )
    assert (found.setpoints["margin"] >= -1e-9).all()
    assert set(found.statuses) <= {"certified", "uncertified"}
    assert np.abs(found.speeds).max() <= 0.6 * (1 + 1e-9)


@pytest.mark.parametrize("limit_rad_s", [0.6, 0.1])
def test_one_norm_with_constraints_is_the_optimum_of_its_linear_program(limit_rad_s, monkeypatch):
    """u has |u|₁ + ½·1e-6·|u|² at most of the vertex v that linprog finds, with u = p − m."""
    speed = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": limit_rad_s}}
    polygon = {"constraint": "support_polygon", "parameters": {"margin_m": 0.005}}
    solve, seen = StableQp.solve, []

    def recorded(solver, gradient, psi, drift, A, b, lower, upper, *rest):
        found = solve(solver, gradient, psi, drift, A, b, lower, upper, *rest)
        rows = (each.copy() for each in (gradient, A, b, lower, upper, solver.u))
        seen.append((solver.rate - drift, *rows))
        return found

    monkeypatch.setattr(StableQp, "solve", recorded)
    constraints = [speed, RANGE, polygon]
    run(settings(objective={"kind": "lp", "p": 1}, constraints=constraints, rho="largest"), 0.2)
    assert len(seen) >= 200
    for rate, gradient, A, b, lower, upper, u in seen[::20]:
        used = np.isfinite(b)
        limits = np.concatenate([np.maximum(upper, 0.0), np.maximum(-lower, 0.0)])
        vertex = linprog(
            np.ones(2 * u.size),
            np.hstack([A[used], -A[used]]),
            b[used],
            np.hstack([gradient, -gradient])[None],
            [rate],
            [(0.0, limit) for limit in limits],
        )
        v = vertex.x[: u.size] - vertex.x[u.size :]
        assert np.abs(u).sum() <= vertex.fun + 0.5e-6 * (v @ v) + 1e-9 * vertex.fun
        between = (np.abs(u) > 1e-9) & (u > lower + 1e-9) & (u < upper - 1e-9)
        assert between.sum() <= 1 + used.sum()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"objective": {"kind": "lp", "p": 3.0}}, "parameters.objective.p"),
        (
            {"objective": {"kind": "lp", "p": 2, "weights": {"r_knee": 2.0}}, "constraints": []},
            "parameters.objective.weights",
        ),
        ({"lyapunov": "descent"}, "parameters.lyapunov"),
        ({"task": {"task": "comm"}}, "parameters.task.task"),
    ],
)
def test_what_is_wrong_for_any_robot_is_refused_without_one(changes, key):
    config = parse(ControllerConfig, settings(**changes), "mine.yaml")
    with pytest.raises((ConfigError, UnknownNameError)) as caught:
        check_parameters(config, "mine.yaml")
    assert key in str(caught.value)
    assert "mine.yaml" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (
            {"objective": {"kind": "qp12", "weights": {"r_kne": 2.0}}},
            "parameters.objective.weights.r_kne",
        ),
        (
            {"constraints": [{"constraint": "joint_position", "parameters": {"eta_per_s": 1001}}]},
            "parameters.constraints.0.parameters.eta_per_s",
        ),
        (
            {
                "task": {"task": "flat_functions:Clock"},
                "objective": {"kind": "least_squares"},
                "constraints": [],
            },
            "parameters.objective.kind",
        ),
    ],
)
def test_what_does_not_fit_the_robot_is_refused_by_its_key(changes, key):
    config = parse(ControllerConfig, settings(**changes), "mine.yaml")
    with pytest.raises((ConfigError, UnknownNameError)) as caught:
        build(config, load("hoap3"), "mine.yaml")
    assert key in str(caught.value)
    assert "mine.yaml" in str(caught.value)
