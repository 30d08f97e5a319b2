"""What a certificate of `stable_qp` claims: each part of it alone can refuse it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from stable_runs import run, settings

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import State
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.robot_emulator.robots import load


def controller_with(spoil: Callable[[Any], None]) -> Any:
    """The shipped controller, of which something is wrong after every solve."""
    description = load("hoap3")
    config = parse(ControllerConfig, settings(), "config")
    controller = build(config, description)
    solve = controller._solver.solve

    def spoiled(*arguments: Any) -> int:
        found: int = solve(*arguments)
        spoil(controller)
        return found

    controller._solver.solve = spoiled
    state = State(description.n, 0)
    state.q[:] = state.reference[:] = description.initial_position
    controller.reset(state, None)
    return controller.step(state)


def test_nothing_spoiled_is_certified():
    assert controller_with(lambda controller: None).solver_status == STATUS["certified"]


def wrong(name: str, value: float) -> Callable[[Any], None]:
    return lambda controller: setattr(controller._solver, name, value)


def beyond_a_limit(controller: Any) -> None:
    controller.stack.constraints[1].margins[0] = -1e-5


@pytest.mark.parametrize(
    "spoil",
    [
        wrong("rho", -1e-6),
        wrong("rate", 0.0),
        wrong("rate", -0.5),
        wrong("kkt_residual", 1e-8),
        wrong("margin", -1e-8),
        beyond_a_limit,
    ],
    ids=[
        "rho",
        "too slow",
        "too fast",
        "residual",
        "margin of the answer",
        "margin of a constraint",
    ],
)
def test_each_part_alone_refuses_it(spoil):
    assert controller_with(spoil).solver_status == STATUS["uncertified"]


def test_a_row_under_which_v_cannot_be_promised_to_fall_refuses_it():
    pushed = {"speed": 0.01, "joints": {"r_ankle_pitch": 1.0, "r_ankle_roll": 1.0}}
    found = run(settings(constraints=[{"constraint": "minimum_speed", "parameters": pushed}]), 0.1)
    assert set(found.statuses) == {"uncertified"}
    assert any("not_orthogonal" in name for name in found.began), dict(found.began)
    assert np.all(np.diff(found.setpoints["v"]) < 0.0)
