"""The problems of `qp12`, `osqp` and `pinv`: true answers hold, and what is changed is found."""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller
from hoap3.remote_controller.problems.check import check_problem
from hoap3.remote_controller.solvers.qp12.osqp_qp12 import OsqpQp12
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import builder_of, check_engagements

sys.path.append(str(Path(__file__).parents[2] / "tools" / "verify"))
from driven import recorded

DISTURBED: dict[str, Any] = {"lost": 0.05, "unseen": 0.03, "noise": 1e-4, "pauses": (90, 91)}
FASTER = {"u_max_rad_s": 0.9, "beta": 60.0, "over_s": 0.05}
AT_ONCE = {"u_max_rad_s": 0.4, "over_s": 0.001}  # the controller holds it back
TICKS = 160
RUNS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "qp12": ("qp12", "hoap3", {"changes": {30: {**FASTER, "gamma": 0.2}, 110: AT_ONCE}}),
    "few joints": ("qp12", "ur5", {"adaptive_gamma": False, "gamma": 1.0, "psi_scale": "one"}),
    "all joints": ("qp12_paper", "hoap3", {"gamma": 0.0, "psi_scale": "max_norm"}),
    "millimetres": (
        "qp12",
        "ur5",
        {"error_unit": "mm", "beta": 0.046, "gamma_slope": 1e-4, "kinematics_from": "reference"},
    ),
    "osqp": ("osqp", "hoap3", {"changes": {30: {**FASTER, "gamma": 0.2}}}),
    "osqp gives up": ("osqp", "hoap3", {"polish": False, "max_iterations": 1}),
    "pinv": ("pinv", "hoap3", {"changes": {30: FASTER}}),
    "plain": ("pinv", "ur5", {"law": "plain", "changes": {30: {"gain_per_s": 4.0}}}),
}


CHANGED = {
    "decision": 1e-6,
    "values": 1e-9,
    "v": 1e-9,
    "v_rate_required": 1e-9,
    "v_rate_predicted": 1e-9,
    "rho": -1e-6,
    "margin": 1e-6,
    "kkt_residual": 1e-6,
    "active_joints": 1,
}


@cache
def run(name: str, ticks: int) -> tuple[list[Record], str, dict[str, Any]]:
    """Records, the controller's name and its parameters."""
    config, robot, settings = RUNS[name]
    records, parameters = recorded(config, robot, ticks, **DISTURBED, **settings)
    return records, config.removesuffix("_paper"), parameters


def checked(
    records: list[Record], controller: str, parameters: dict[str, Any], most: int | None = None
) -> Claims:
    claims, answers = Claims(), sum(record.kind == Kind.SETPOINT for record in records)
    check_engagements(records, controller, parameters, claims, answers=answers, most=most)
    return claims


def with_change(record: Record, field: str, by: float) -> tuple[Record, int]:
    """An answer of which one field is another, or one entry of it; and its tick."""
    setpoint = Setpoint.like(record.payload)
    setpoint.load(record.payload)
    if field in {"decision", "values"}:
        getattr(setpoint, field)[3] += by
    else:
        setattr(setpoint, field, getattr(setpoint, field) + by)
    return record._replace(payload=setpoint.dump()), setpoint.tick


@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_disturbed_run(name):
    found = checked(*run(name, TICKS))

    assert found.by_tick() == []
    assert found.unverifiable == 0
    assert found.counts["residual"].checked > 0.9 * TICKS


def test_a_sample_of_the_answers_is_checked_within_a_ramp():
    found = checked(*run("qp12", TICKS), most=30)

    assert found.by_tick() == []
    assert 10 < found.counts["V"].checked < 60


def test_a_ramp_begins_with_a_state_that_is_not_finite():
    records, controller, parameters = run("qp12", TICKS)
    records, kinds = list(records), [record.kind for record in records]
    place = kinds.index(Kind.STATE)
    state = State.like(records[place].payload)
    state.load(records[place].payload)
    state.q[0] = np.nan
    records[place] = records[place]._replace(payload=state.dump())

    found = checked(records, controller, parameters)

    assert found.by_tick() == []
    assert found.unverifiable == 1


@pytest.mark.parametrize("name", ["qp12", "few joints", "osqp", "pinv", "plain"])
def test_each_changed_number_is_found_at_its_tick(name):
    records, controller, parameters = run(name, TICKS)
    records, answers = list(records), [i for i, r in enumerate(records) if r.kind == Kind.SETPOINT]
    changed = {}
    for place, (field, by) in zip(answers[3::15], CHANGED.items(), strict=False):
        records[place], tick = with_change(records[place], field, by)
        changed[tick] = field

    found = {one.tick for one in checked(records, controller, parameters).by_tick()}

    assert list(changed.values()) == list(CHANGED)
    assert {tick: field for tick, field in changed.items() if tick not in found} == {}
    assert found <= changed.keys()


@pytest.mark.parametrize("name", ["qp12", "few joints"])
def test_a_wrong_answer_is_found_although_its_certificate_admits_it(name, monkeypatch):
    descend = Qp12Controller.descend

    def give_up(self: Qp12Controller, certificate: Any) -> int:
        found = descend(self, certificate)
        if certificate[0] > 0.0:
            self.u[:] = certificate[2] = 0.0
            certificate[4:] = self._u_max, 1.0
        return found

    monkeypatch.setattr(Qp12Controller, "descend", give_up)
    config, robot, settings = RUNS[name]
    records, parameters = recorded(config, robot, 20, **settings)

    found = checked(records, config, parameters)

    assert found.counts["residual"].false == 0
    assert found.counts["optimum: residual"].false == 20


@pytest.mark.parametrize(("by", "false"), [(1.0, 0), (1.0 + 1e-3, 20)])
def test_osqp_answers_with_the_required_rate(by, false, monkeypatch):
    solve = OsqpQp12.solve

    def solve_scaled(
        self: OsqpQp12, gradient: Any, decrease: float, gamma: float, out: Any
    ) -> None:
        solve(self, gradient, by * decrease, gamma, out)

    monkeypatch.setattr(OsqpQp12, "solve", solve_scaled)
    records, parameters = recorded("osqp", "hoap3", 20)

    found = checked(records, "osqp", parameters)

    assert found.false == false
    assert found.counts["row to OSQP's tolerance"].false == false


@pytest.mark.parametrize("name", ["qp12", "osqp", "pinv"])
def test_a_velocity_that_overflows_is_found(name):
    records, controller, parameters = run(name, TICKS)
    records, kinds = list(records), [record.kind for record in records]
    place = kinds.index(Kind.SETPOINT)
    records[place], tick = with_change(records[place], "decision", 1e308)

    assert {one.tick for one in checked(records, controller, parameters).by_tick()} == {tick}


@pytest.mark.parametrize("name", ["qp12", "few joints", "all joints", "millimetres"])
def test_an_answer_with_the_same_v_rate_that_is_not_optimal_is_found(name):
    records, controller, parameters = run(name, TICKS)
    robot, session = (record.payload for record in records[:2])
    made = RobotDescription.from_json(robot), parameters, json.loads(session), controller
    builder = builder_of(controller, parameters)(*made)
    random = np.random.default_rng(0)
    for kind, _, payload in records[2:]:
        builder.feed(kind, payload)
        if kind != Kind.SETPOINT:
            continue
        statement = builder.problem()
        program, u = statement.problems[0](), statement.answer
        gradient = program.rows.A[0]
        step = random.normal(size=u.size)
        step -= gradient * (gradient @ step) / (gradient @ gradient)
        for away in (1e-3, 1e-7):
            other = u + away * np.abs(u).max() * step
            found = check_problem(program, other, statement.answer_error)
            assert {each.name: each.holds for each in found} == {"rows": True, "optimum": False}


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_long_run(name):
    config, robot, settings = RUNS[name]
    changes = {
        tick: {**FASTER, "u_max_rad_s": 0.3 + 0.1 * (tick % 7)} for tick in range(200, 20_000, 400)
    }
    records, parameters = recorded(
        config, robot, 20_000, **DISTURBED, **{**settings, "changes": changes}
    )

    found = checked(records, config.removesuffix("_paper"), parameters)

    assert found.by_tick() == []
    assert found.unverifiable == 0
