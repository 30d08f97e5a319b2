"""Certificates whose fields cannot be true are never counted, wherever answers are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.small_arm import arm

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.base import STATUS, VelocityController
from hoap3.remote_controller.controllers.certificate import FIELDS, checked_statuses, invalid_field
from hoap3.remote_controller.outcome import Outcome
from hoap3.tools.analysis.certificates import CertificateCount

NAN, INF = math.nan, math.inf
BAD = [
    *[(field, NAN) for field in FIELDS],
    *[(field, INF) for field in FIELDS if field != "margin"],
    *[(field, -INF) for field in FIELDS],
    *[("v", -1.0), ("v", -1e-300), ("rho", -0.1), ("rho", 1.1), ("kkt_residual", -1e-9)],
    *[("v_rate_predicted", 5.0), ("v_rate_predicted", 1e-11), ("kkt_residual", 1.0)],
]
GOOD = [("v", -0.0), ("v", 1e300), ("rho", 0.0), ("margin", INF), ("margin", -1.0)]
GOOD += [("v_rate_predicted", -1.0)]


class Idle(VelocityController):
    """Certifies that nothing moves."""

    def velocity(self, state: State) -> np.ndarray:
        return np.zeros(self.description.n)


def answer(field: str, value: float, status: int = 0) -> Setpoint:
    setpoint = Setpoint(3)
    setpoint.rho, setpoint.margin, setpoint.solver_status = 1.0, 1.0, status
    if field == "values":
        setpoint.values[1] = value
    elif field:
        setattr(setpoint, field, value)
    return setpoint


def counted(setpoint: Setpoint) -> dict:
    """The answer as live counts, the controller's summary, and verify have it."""
    count = CertificateCount()
    count.add(Record(Kind.SETPOINT, 0, setpoint.dump()))
    description = arm()
    outcome = Outcome(Idle(description, Idle.Parameters()), description)
    outcome.note(State(3), setpoint)
    told = outcome.as_json()
    rows = np.frombuffer(setpoint.dump(), Setpoint.schema.dtype(setpoint.lengths))
    return {"count": count.figures(), "outcome": told, "statuses": checked_statuses(rows).tolist()}


@pytest.mark.parametrize("status", [STATUS["certified"], STATUS["at_target"]])
@pytest.mark.parametrize(("field", "value"), BAD)
def test_an_invalid_field_is_uncertified_and_named(field, value, status):
    setpoint = answer(field, value, status)
    assert invalid_field(setpoint) == field
    found, reason = counted(setpoint), f"invalid certificate: {field}"
    assert found["count"]["without"] == found["count"]["uncertified"] == 1
    assert found["count"]["reasons"] == {"uncertified": {reason: 1}}
    assert (found["outcome"]["certified"], found["outcome"]["certifiable"]) == (0, 1)
    assert found["outcome"]["not_certified"] == {reason: 1}
    assert found["statuses"] == [STATUS["uncertified"]]


@pytest.mark.parametrize("status", [STATUS["certified"], STATUS["at_target"]])
@pytest.mark.parametrize(("field", "value"), [("", 0.0), *GOOD])
def test_valid_certificates_count(field, value, status):
    found = counted(answer(field, value, status))
    assert found["count"]["without"] == 0
    assert (found["outcome"]["certified"], found["outcome"]["not_certified"]) == (1, {})
    assert found["statuses"] == [status]


@pytest.mark.parametrize("status", [5, 200, 2**32 - 1])
def test_an_undefined_status_is_named(status):
    found, reason = counted(answer("", 0.0, status)), "invalid certificate: solver_status"
    assert found["statuses"] == [status]
    assert found["count"]["reasons"] == {"unknown": {reason: 1}}
    assert found["outcome"]["not_certified"] == {reason: 1}


@pytest.mark.parametrize("status", [STATUS["uncertified"], STATUS["infeasible"], STATUS["none"]])
def test_answers_without_proof_may_hold_anything(status):
    assert invalid_field(answer("v", NAN, status)) == ""


class Runaway(Idle):
    """Says at target, and moves faster than the robot can."""

    def velocity(self, state: State) -> np.ndarray:
        self.command.solver_status = STATUS["at_target"]
        return np.full(self.description.n, self.speed)


@pytest.mark.parametrize(("speed", "status"), [(1e9, "uncertified"), (0.0, "at_target")])
def test_at_target_does_not_outlive_a_limit_that_holds_the_robot_back(speed, status):
    controller, state = Runaway(arm(), Runaway.Parameters()), State(3)
    controller.speed = speed
    controller.reset(state, None)
    assert controller.step(state).solver_status == STATUS[status]
