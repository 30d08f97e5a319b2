"""Parts of the problems of accelerations: bounds, schedules, defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

from hoap3.protocol.limits import viability_bounds_oracle as reference
from hoap3.remote_controller.problems import joint_acceleration, schedule
from hoap3.remote_controller.problems.ghc import GhcProblems, GhcTorqueProblems
from hoap3.remote_controller.problems.hqp import HqpProblems
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.tsid import TsidProblems
from hoap3.remote_controller.problems.weighted import WeightedProblems
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.scheduling.priorities import Priorities, PrioritySettings
from hoap3.remote_controller.scheduling.weights import Weights, WeightSettings
from hoap3.tools.verify.statements import BUILDERS


def test_bounds_are_those_that_their_meaning_gives() -> None:
    rng = np.random.default_rng(5)
    n, T = 4000, 0.002
    speed, up, down = (rng.uniform(low, 2 * low, n) for low in (1.0, 20.0, 20.0))
    found = bounds.Bounds(
        "viability", np.full(n, -1.0), np.full(n, 1.0), speed, up, down, up, T, 0.8, 0.0
    )
    room = 10.0 ** rng.uniform(-5.0, -1.5, n)  # of the upper limit
    fastest = np.minimum(speed, np.sqrt(2 * 0.8 * down * room))
    q, v = 1.0 - room, fastest * rng.uniform(0.97, 1.0, n)

    lower, upper = found.at(q, v)

    stops = reference.bounds(1.0 - q, q + 1.0, v, speed, up, 0.8 * down, T)
    held = (np.abs(stops[1]) < 0.7 * up) & (np.abs(stops[1]) < 0.7 * down)
    assert held.sum() > n / 10
    assert np.abs(upper - stops[1])[held].max() < 1e-9 * up.max()
    mirrored = found.at(-q, -v)[0]
    assert np.array_equal(replace(found, up=down, down=up).at(q, v)[1], -mirrored)
    assert (lower <= upper).all()


@pytest.mark.parametrize("seed", range(3))
def test_priorities_and_weights_move_as_the_products_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = ["a", "b", "c"]
    timeline = [
        {"at_s": 0.0105, "order": ["c", ["a", "b"]], "over_s": 0.02},
        {"at_s": 0.04, "remove": "b", "over_s": 0.015},
        {"at_s": 0.07, "insert": ["b"], "over_s": 0.0},
        {"at_s": 0.0701, "set": [["a", "a", 0.3]], "over_s": 0.004},
    ]
    order = {"order": ["b", "a", "c"], "inactive": [], "timeline": timeline}
    moves = [{"at_s": 0.02, "weights": {"a": 0.0, "c": 3.0}, "over_s": 0.03}]
    weights = {"weights": {"b": 0.2}, "timeline": moves}
    ours = schedule.Priorities(names, order), schedule.Weights(names, weights)
    theirs = (
        Priorities(names, PrioritySettings.model_validate(order)),
        Weights(names, WeightSettings.model_validate(weights)),
    )
    live = rng.uniform(0.0, 0.1)
    for tick in range(100):
        time = 1e-3 * tick
        if time <= live < time + 1e-3:
            ours[0].change({"set": [["a", "b", 0.25]], "over_s": 0.01}, time)
            theirs[0].change({"set": [["a", "b", 0.25]], "over_s": 0.01}, time)
        for product in theirs:
            product.update(time)
        assert np.allclose(ours[0].at(time), theirs[0].alpha, rtol=0, atol=1e-15), tick
        assert np.allclose(ours[1].at(time), theirs[1].value, rtol=0, atol=1e-15), tick


def test_defaults_are_those_of_the_controllers() -> None:
    tables = {
        "joint_acceleration": joint_acceleration.DEFAULTS,
        "tsid": TsidProblems.defaults,
        "weighted": WeightedProblems.defaults,
        "ghc": GhcProblems.defaults,
        "ghc_torque": {k: v for k, v in GhcTorqueProblems.defaults.items() if k != "regularise"},
        "hqp": HqpProblems.defaults,
    }
    for name, table in tables.items():
        _assert_defaults(find(name).Parameters, table)


@pytest.mark.parametrize("builder", [GhcProblems, GhcTorqueProblems, HqpProblems, WeightedProblems])
def test_the_least_regularisation_is_that_of_the_controllers(builder) -> None:
    name = next(key for key, value in BUILDERS.items() if value.endswith(f":{builder.__name__}"))
    model = find(name).Parameters

    model.model_validate({"tasks": [{"task": "posture"}], "w_r": builder.least_w_r})
    with pytest.raises(ValidationError, match="w_r"):
        model.model_validate({"tasks": [{"task": "posture"}], "w_r": 0.99 * builder.least_w_r})


def _assert_defaults(model: type[BaseModel], table: Mapping[str, Any]) -> None:
    fields = model.model_fields
    for key, value in table.items():
        default = fields[key].default
        if isinstance(value, dict):
            _assert_defaults(type(default), value)
            given = {field: getattr(default, field) for field in value}
            assert given == {field: given[field] if v is None else v for field, v in value.items()}
        else:
            assert (default or None) == (value or None), key
