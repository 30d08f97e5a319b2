"""The problems of `stable_qp`: what its answers claim holds while all around them changes."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.messages import Setpoint, Target
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.certificate import STATUS
from hoap3.remote_controller.problems.stable_qp import StableQpProblems
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import check_statements

sys.path.append(str(Path(__file__).parents[2] / "tools" / "verify"))
from driven import recorded

DISTURBED: dict[str, Any] = {"lost": 0.05, "unseen": 0.03, "noise": 1e-4, "pauses": (150, 151)}
OTHERS = {
    "objective": {"gamma": 0.2},
    "psi": {"u_max_rad_s": 0.3, "beta": 20.0},
    "task": {"parameters": {"weights": [1.0, 2.0, 1.0]}},
    "constraints.support_polygon.parameters.eta_per_s": 5.0,
    "constraints.joint_velocity.parameters.limit_rad_s": 0.5,
    "over_s": 0.05,
}
SLOW = [{"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.01}}]
HAND = {
    "task": "frame_position",
    "parameters": {"frame": "tool0", "target": {"kind": "live", "name": "hand"}},
}
RUNS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "changes": ("stable_qp_hoap3", "hoap3", {"changes": {40: OTHERS}}),
    "moving target": ("com_tracking", "hoap3", {}),
    "curve": ("com_circulation", "hoap3", {}),
    "slow joints": ("stable_qp", "hoap3", {"constraints": SLOW, "rho": "largest"}),
    "largest speed": ("stable_qp", "hoap3", {"objective": {"kind": "lp", "p": "inf"}}),
    "steered": ("stable_qp", "ur5", {"task": HAND}),
}


def points(ticks: int) -> dict[int, bytes]:
    """Messages for a live target: a point that jumps every 300 ticks."""
    found = {}
    for k, tick in enumerate(range(20, ticks, 300)):
        target = Target(1, 3)
        target.first_tick, target.number = tick, k + 1
        target.values[:] = np.array([0.4, 0.2, 0.4]) + 0.05 * np.sin([k, 2.0 * k, 3.0 * k])
        found[tick] = target.dump()
    return found


def run(name: str, ticks: int) -> tuple[list[Record], dict[str, Any]]:
    config, robot, settings = RUNS[name]
    targets = points(ticks) if name == "steered" else {}
    return recorded(config, robot, ticks, targets=targets, **DISTURBED, **settings)


def checked(records: list[Record], parameters: dict[str, Any]) -> Claims:
    claims = Claims()
    session, robot = json.loads(records[1].payload), RobotDescription.from_json(records[0].payload)
    builder = StableQpProblems(robot, parameters, session)
    check_statements(records[2:], builder, claims)
    return claims


@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_disturbed_run(name):
    found = checked(*run(name, 250))

    assert found.by_tick() == []
    assert found.unverifiable == 0
    assert found.counts["optimum"].checked > 200


@pytest.mark.parametrize("name", ["changes", "slow joints"])
@pytest.mark.parametrize(
    "field", ["decision", "values", "v", "v_rate_predicted", "v_rate_required", "rho", "margin"]
)
def test_a_changed_number_is_found_at_its_tick(name, field):
    records, parameters = run(name, 80)
    place = [i for i, record in enumerate(records) if record.kind == Kind.SETPOINT][60]
    setpoint = Setpoint.like(records[place].payload)
    setpoint.load(records[place].payload)
    if field in {"decision", "values"}:
        getattr(setpoint, field)[3] += 1e-6
    else:
        setattr(setpoint, field, getattr(setpoint, field) * (1.0 + 1e-6) + 1e-9)
    records[place] = records[place]._replace(payload=setpoint.dump())

    found = checked(records, parameters)

    assert {one.tick for one in found.by_tick()} == {setpoint.tick}


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_long_run(name):
    records, parameters = run(name, 20_000)
    begin = time.process_time()

    found = checked(records, parameters)

    cycles = found.counts["V"].checked
    print(f"{name}: {1e3 * (time.process_time() - begin) / cycles:.2f} ms a cycle, {cycles} cycles")
    assert found.by_tick() == []


@pytest.mark.parametrize(("residual", "unverified"), [(0.9e-8, 0), (1.1e-8, 1), (np.inf, 1)])
def test_an_optimum_that_a_large_residual_excuses_is_not_verified(residual, unverified):
    records, parameters = run("slow joints", 40)
    place = [i for i, record in enumerate(records) if record.kind == Kind.SETPOINT][20]
    setpoint = Setpoint.like(records[place].payload)
    setpoint.load(records[place].payload)
    setpoint.kkt_residual, setpoint.solver_status = residual, STATUS["uncertified"]
    records[place] = records[place]._replace(payload=setpoint.dump())

    found = checked(records, parameters)

    assert found.by_tick() == []
    assert found.unverifiable == unverified


def test_a_velocity_that_is_not_a_number_is_not_verified():
    records, parameters = run("slow joints", 40)
    place = [i for i, record in enumerate(records) if record.kind == Kind.SETPOINT][20]
    setpoint = Setpoint.like(records[place].payload)
    setpoint.load(records[place].payload)
    setpoint.decision[3] = np.nan
    records[place] = records[place]._replace(payload=setpoint.dump())

    found = checked(records, parameters)

    assert found.by_tick() == []
    assert found.unverifiable == 1
