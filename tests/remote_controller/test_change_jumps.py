"""No change makes velocities jump by more than is configured, whatever is asked for."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from changed_numbers import LAWS, built, with_parameters
from hypothesis import given, settings
from hypothesis import strategies as some

from hoap3.protocol.errors import UsageError
from hoap3.remote_controller.controllers.base import Controller, VelocityController
from hoap3.tools.testing.controller_case import controller_case

FEW = ("pinv", "joint_acceleration")
EACH = [law if law in FEW else pytest.param(law, marks=pytest.mark.slow) for law in LAWS]
BEFORE, AFTER = 15, 25  # ticks
JUMP = 1e-3  # rad/s
ROUNDING = 1e-8


@cache
def pair(law: str) -> tuple[Controller, Controller]:
    """A controller, and another that is never changed but by hand."""
    case = controller_case(law, None)
    config, quick = case.config, {"ramp_s": 0.005}
    if law in {"qp12", "osqp", "pinv"}:
        config = with_parameters(config, change_jump_rad_s=JUMP, **quick)
    elif law == "stable_qp_hoap3":
        psi = {**config.parameters.get("psi", {}), **quick}
        config = with_parameters(config, change_jump_rad_s=JUMP, psi=psi)
    elif law in {"clik_ur5", "clik_sdp_ur5", "ghc_velocity"}:
        config = with_parameters(config, change_jump_rad_s=JUMP)
    return built(case, config), built(case, config)


def factors(law: str) -> Any:
    """Numbers of a law, each with what it is multiplied by, and how long that takes."""
    numbers = pair(law)[0]._ready_for_changes().numbers
    places = some.sampled_from(range(len(numbers)))
    by = some.floats(-1.5, 1.5).map(lambda exponent: 10.0**exponent)
    chosen = some.dictionaries(places, by, min_size=1, max_size=4)
    return some.tuples(chosen, some.sampled_from([0.0, 0.004, 0.02]))


def asked(controller: Controller, chosen: dict[int, float]) -> dict[str, Any]:
    """A request by the factors of its numbers."""
    found: dict[str, Any] = {}
    changes = controller._ready_for_changes()
    for place, factor in chosen.items():
        number = changes.numbers[place]
        value, present = number.read(), number.numbers(number.read(), controller.description)
        found[number.key] = [factor] if isinstance(value, tuple) else factor * present[0]
    return found


def follow(other: Controller, controller: Controller) -> None:
    """Give another controller the numbers that one has now."""
    mine, theirs = controller._ready_for_changes(), other._ready_for_changes()
    for number, its in zip(mine.numbers, theirs.numbers, strict=True):
        its.write(number.read())
    theirs._apply_present(theirs._parts)


@pytest.mark.parametrize("law", EACH)
def test_a_change_alone_alters_no_velocity_by_more_than_its_jump(law):
    case = controller_case(law, None)
    controller, unchanged = pair(law)
    T, n = case.robot.period_s, case.robot.n

    @settings(max_examples=12, deadline=None)
    @given(factors(law))
    def holds(drawn: tuple[dict[int, float], float]) -> None:
        body = case.body()
        for each in (controller, unchanged):
            each.forget_changes()
            each.reset(body.state, None)
        for tick in range(BEFORE + AFTER):
            if tick == BEFORE:
                try:
                    controller.change({**asked(controller, drawn[0]), "over_s": drawn[1]})
                except UsageError:
                    return
            before = controller.command.decision[:n].copy()
            follow(unchanged, controller)
            alone = unchanged.step(body.state).decision[:n].copy()
            command = controller.step(body.state)
            now = command.decision[:n]
            if isinstance(controller, VelocityController) and tick >= BEFORE:
                most = controller._jump + np.abs(alone - before)
                assert (np.abs(now - before) <= most + ROUNDING).all()
            elif tick >= BEFORE and command.fallback == 0:
                bounds = getattr(controller, "bounds", None) or controller._bounds
                assert (np.abs(now) * T <= bounds.greatest * T * (1.0 + ROUNDING)).all()
            body.follow(command.values)

    holds()
