"""Robots that follow trajectories in lockstep: how near, and what a violated tolerance does."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.controllers.base import VIOLATED
from hoap3.remote_controller.references.trajectories.motion_file import read_motion
from hoap3.remote_controller.references.trajectories.trajectory import Trajectory
from hoap3.robot_emulator.robots import load
from hoap3.tools.services.simulate import Simulation, simulate

UR5 = load("ur5")
T = UR5.period_s
PAN, ELBOW = UR5.joint_names.index("shoulder_pan_joint"), UR5.joint_names.index("elbow_joint")
ROWS = "0,0,1.6,0,0,0,0\n0.2,0.03,1.57,0.1,-0.2,1,-1\n0.45,0.01,1.62,0,0,0,0\n"
PARTS = ("", "/velocity", "/acceleration")
HEADER = ["t", *(f"{UR5.joint_names[i]}{part}" for part in PARTS for i in (PAN, ELBOW))]
CSV = ",".join(HEADER) + "\n" + ROWS
FORMS = {
    "clik": ("tasks", {"gain_per_s": 5.0}),
    "clik_sdp": ("tasks", {}),
    "ghc_velocity": ("tasks", {"gain_per_s": 5.0}),
    "stable_qp": ("task", {}),
    "weighted": ("tasks", {"kp": 400.0}),
}


def slow(name: str) -> Any:
    return pytest.param(name, marks=pytest.mark.slow)


def run(controller: str, duration: float, **target: Any) -> Simulation:
    key, gains = FORMS[controller]
    target = {"kind": "trajectory", "csv": CSV, "approach_s": 0.0, **target}
    task = {"task": "posture", "parameters": {"target": target}, **gains}
    parameters = {key: task if key == "task" else [task]}
    return simulate("ur5", {"controller": controller, "parameters": parameters}, duration)


def wanted(states: np.ndarray, first: int) -> tuple[np.ndarray, float]:
    """q_d of both joints at each State, and the greatest acceleration between two of them."""
    names = (UR5.joint_names[PAN], UR5.joint_names[ELBOW])
    path = Trajectory(read_motion(CSV, "a.csv", names), "quintic")
    path.start(UR5.initial_position[[PAN, ELBOW]], 0.0)
    places, velocities = np.zeros((2, len(states), 2))
    for k, tick in enumerate(states["tick"].tolist()):
        path.at((tick - first) * T, places[k], velocities[k])
    return places, float(np.abs(np.diff(velocities, axis=0)).max()) / T


@pytest.mark.parametrize("controller", ["clik", slow("clik_sdp")])
def test_joints_are_as_near_as_one_period_allows(controller):
    """|q − q_d| ≤ T²/2·max|q̈| on an ideal plant; other joints do not move at all."""
    done = run(controller, 0.5)
    states = done.states[done.states["tick"] >= done.setpoints["tick"][0]]
    places, bend = wanted(states, int(done.setpoints["tick"][0]))
    assert bend > 3.0
    off = np.abs(states["q"][:, [PAN, ELBOW]] - places)
    assert off.max() <= 0.5 * T**2 * bend
    others = [i for i in range(UR5.n) if i not in (PAN, ELBOW)]
    assert np.abs(np.diff(states["q"][:, others], axis=0)).max() <= 1e-15


def told(done: Simulation) -> dict[str, Any]:
    """What the controller summed up of its task when the robot stopped following."""
    (summary,) = (each.payload for each in done.log.records if each.kind == Kind.SUMMARY)
    (error,) = json.loads(summary)["tasks"]
    return error


@pytest.mark.parametrize("controller", ["clik", *map(slow, list(FORMS)[1:])])
def test_a_violated_tolerance_holds_the_joints_and_fails_the_task(controller):
    done = run(controller, 0.25, path_tolerance=1e-12)
    first, last = done.setpoints["tick"][[0, -1]].tolist()
    states = done.states[(done.states["tick"] >= first) & (done.states["tick"] <= last)]
    places, _ = wanted(states, first)
    off = np.abs(states["q"][:, [PAN, ELBOW]] - places)
    tick = int(np.flatnonzero((off > 1e-12).any(1))[0])

    error = told(done)
    assert (error["within"], error["judged"]) == (False, True)
    assert error["error"] == pytest.approx(np.degrees(off[tick].max()), rel=1e-6)
    assert error["tolerance"] == pytest.approx(np.degrees(1e-12))
    name = UR5.joint_names[(PAN, ELBOW)[int(off[tick].argmax())]]
    assert name in error["reason"]
    assert f"tick {first + tick}," in error["reason"]
    assert began(done) == [first + tick]
    held = states["q"][tick]
    assert np.abs(states["q"][tick:] - held).max() < 1e-4  # and the motion goes on by 0.04 rad
    assert np.abs(places[tick:] - places[tick]).max() > 0.03


def began(done: Simulation) -> list[int]:
    """Ticks at which the log says that a tolerance is violated, and until the end it is."""
    kinds, number = Event.schema.constants, done.controller.conditions.index(VIOLATED)
    found = []
    for record in done.log.records:
        if record.kind == Kind.EVENT:
            event = Event()
            event.load(record.payload)
            if (event.kind, event.detail) == (kinds["CONDITION_BEGAN"], number):
                found.append(event.tick)
    return found


@pytest.mark.slow
def test_who_goes_on_after_a_violation_arrives():
    done = run("clik", 0.5, path_tolerance=1e-12, if_violated="continue")
    error = told(done)
    assert not error["within"]
    assert error["reason"]
    np.testing.assert_allclose(done.states["q"][-1][[PAN, ELBOW]], [0.01, 1.62], atol=1e-6)


def test_who_keeps_its_tolerances_has_no_reason_to_tell():
    done = run("clik", 0.5, path_tolerance=1e-4, goal_tolerance=1e-5, goal_time_s=0.01)
    error = told(done)
    assert (error["within"], error["reason"]) == (True, "")
    assert began(done) == []
    assert VIOLATED not in run("clik", 0.01).controller.conditions


def test_a_goal_that_is_not_reached_at_its_time_is_a_violation():
    done = run("ghc_velocity", 0.5, goal_tolerance=1e-12, goal_time_s=0.02)
    end = int(done.setpoints["tick"][0]) + round((0.45 + 0.02) / T)
    assert began(done) == [end]
    assert f"tick {end}," in told(done)["reason"]
