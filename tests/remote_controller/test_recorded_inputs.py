"""What a controller's log has besides States and Setpoints: resets, requests, the robot's side."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hoap3
from hoap3.protocol.errors import UsageError
from hoap3.protocol.link.base import Request
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.service import serve

PLAIN = ["qp12", "clik_sdp_hoap3", "ghc_velocity", "joint_acceleration"]


def told(log: list, kind: Kind) -> list[dict]:
    """Records of a kind, as JSON."""
    return [json.loads(record.payload) for record in log if record.kind == kind]


@pytest.mark.parametrize("controller", PLAIN)
def test_a_reset_is_recorded_with_what_was_sent_last(controller):
    done = hoap3.simulate("hoap3", controller, duration=0.02)
    resets = told(done.records, Kind.RESET)
    assert [reset["last_command"] is None for reset in resets] == [True, False]
    assert resets[1]["last_command"] == done.setpoints["values"][-1].tolist()
    assert resets[1]["tick"] == done.setpoints["tick"][-1] + 1


def test_the_robots_configuration_stands_in_the_controllers_log():
    done = hoap3.simulate("hoap3", "qp12", duration=0.01)
    (robots,) = told(done.records, Kind.CONFIG)
    assert robots["side"] == "robot"
    assert json.loads(robots["config"])["robot"] == "hoap3"


@pytest.mark.parametrize("controller", ["qp12", "clik_sdp_hoap3", "ghc_velocity"])
def test_the_decision_is_the_velocity_that_the_setpoint_is_the_integral_of(controller):
    done = hoap3.simulate("hoap3", controller, duration=0.05)
    states = done.states[np.isin(done.states["tick"], done.setpoints["tick"])]
    u = done.setpoints["decision"]
    assert np.array_equal(done.setpoints["values"], states["reference"] + u * 1e-3)
    assert np.abs(u).max() > 1e-3


def test_the_decision_of_torques_is_accelerations_and_then_torques():
    done = hoap3.simulate("lwr_weightless", "weighted", duration=0.05)
    ddq, tau = np.split(done.setpoints["decision"], 2, axis=1)
    assert np.array_equal(tau, done.setpoints["values"])  # nothing is added to weightless arms
    assert np.abs(ddq).max() > 0.01


def test_gains_are_those_of_all_rows():
    done = hoap3.simulate("hoap3", "clik_sdp_hoap3", duration=0.02)
    names = [name for name in done.controller.extra_names if name.startswith("gain_")]
    logged = done.setpoints["extra"][:, -len(names) :]
    assert np.array_equal(done.setpoints["gains"], logged)
    assert (done.setpoints["gains"] > 0.0).any()


class Loop:
    """Notes what is recorded of a request."""

    def __init__(self) -> None:
        self.noted: list[tuple[str, dict]] = []

    def change(self, body: bytes) -> None:
        if body != b"{}":
            raise UsageError("no such thing")

    def changeable(self) -> dict:
        return {"speed": 1.0}

    def note_request(self, request: Request, error: str | None) -> None:
        self.noted.append((request.who, error))


@pytest.mark.parametrize("body", [b"{}", b"nonsense"])
def test_what_a_controller_is_asked_is_recorded_with_its_answer(body):
    loop, answers = Loop(), []
    serve(Request("change", "somebody", answers.append, body), loop)
    assert loop.noted == [("somebody", answers[0]["error"])]
    assert (answers[0]["error"] is None) == (body == b"{}")


def test_a_setpoint_that_holds_nothing_new_is_as_long_as_one_without():
    assert Setpoint(3).size == Setpoint(3, decision=0, next=0).size
    assert State(3).size == State(3, base=0).size
