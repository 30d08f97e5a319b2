"""Numbers that change while a controller runs, for every shipped law; most laws are slow."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any

import numpy as np
import pytest
from changed_numbers import (
    LAWS,
    OVER_S,
    REQUESTS,
    TICK,
    WITH_CONSTRAINTS,
    answers,
    asking,
    built,
    changed_run,
    with_parameters,
)
from pydantic import Field
from support.checked_answers import check_answers

from hoap3.protocol.config.changeable import CHANGEABLE, Unset
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.controllers.base import VelocityController
from hoap3.remote_controller.registry import BUILTIN
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.simulate import simulate
from hoap3.tools.testing.controller_case import controller_case
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs

SOME = ("qp12",)
EACH = [law if law in SOME else pytest.param(law, marks=pytest.mark.slow) for law in LAWS]
WARM = {"osqp": 1e-5, "clik_sdp_ur5": 1e-4}
"""Laws that begin where their last answer was: how far that may be from one that did not [rad/s].
OSQP ends within its tolerance, 1e-5 of velocities below 1 rad/s. Of the SDP the gap is at most 1e-9
of β̃², and its objective has the curvature δ: λ is known to √(1e-9)·β̃/√δ = 2e-4/s, and turns errors
of 0.1 m into velocities by less than 5 rad/m."""


def test_there_is_a_change_for_every_shipped_controller():
    assert {controller_case(law, None).config.controller for law in LAWS} == {*BUILTIN}


def judged(config: Any, done: Any, *, heed: bool = True) -> Claims:
    records = [each for each in done.records if heed or each.kind != Kind.CHANGE]
    return check_answers(records, config.controller, config.parameters)


@pytest.mark.parametrize("law", EACH)
def test_a_run_with_a_change_is_replayed_to_the_bit_and_true(law):
    config, done = changed_run(law)
    assert replay_records(done.records, config, file=law).identical
    claims = judged(config, done)
    assert claims.checked > 1000
    assert not claims.false, claims.as_json()["false_claims"]
    assert not claims.unverifiable


@pytest.mark.parametrize("law", EACH)
def test_its_claims_are_false_of_the_numbers_that_it_began_with(law):
    config, done = changed_run(law)
    assert judged(config, done, heed=False).false


def written(content: Any, keys: list[str], value: Any) -> None:
    """Write a number into parameters, as a config has it."""
    for key in keys[:-1]:
        if isinstance(content, list):
            names = [
                each.get("name") or each.get("task") or each.get("constraint") for each in content
            ]
            content = content[names.index(key) if key in names else int(key)]
        else:
            content = content.setdefault(key, {})
    content[keys[-1]] = value


def flat(node: Any, *prefix: str) -> list[tuple[list[str], Any]]:
    found = []
    for key, value in node.items():
        path = (*prefix, *key.split("."))
        found += flat(value, *path) if isinstance(value, dict) else [([*path], value)]
    return found


@pytest.mark.parametrize(
    "law", [*EACH, *(pytest.param(name, marks=pytest.mark.slow) for name in WITH_CONSTRAINTS)]
)
def test_in_the_end_it_is_as_if_it_had_begun_with_the_new_numbers(law):
    """Caches, warm starts and compiled gains follow: all that it decides is the same."""
    config, done = changed_run(law)
    case = controller_case(law, None)
    changed = answers(built(case, config), done, {5: {**REQUESTS[law], "over_s": OVER_S}})
    parameters = json.loads(json.dumps(config.parameters))
    for keys, value in flat(REQUESTS[law]):
        written(parameters, keys, value)
    fresh = answers(built(case, with_parameters(config, **parameters)), done, {})
    arrived = slice(TICK, None)
    off = np.abs(changed[arrived] - fresh[arrived]).max()
    assert off <= WARM.get(law, 0.0)
    assert (changed[5:30] != fresh[5:30]).any()


@pytest.mark.parametrize("law", EACH)
def test_who_begins_anew_has_the_numbers_of_the_config(law):
    config, done = changed_run(law)
    case = controller_case(law, None)
    once = built(case, config)
    shown = once.changeable()
    first = answers(once, done, {})
    once.change({**LAWS[law], "over_s": 0.01})
    answers(once, done, {0: LAWS[law]})
    assert (answers(once, done, {}) == first).all() or law in WARM
    assert once.changeable() == shown


BAD = [
    ({"gama": 0.3}, "gama"),
    ({"gamma": 3.0}, "gamma: "),
    ({"gamma": float("nan")}, "gamma: "),
    ({"gamma": None}, "gamma: "),
    ({"gamma": {"of": 0.3}}, "gamma: "),
    ({"psi_scale": "one"}, "psi_scale: "),
    ({"change_over_s": 1.0}, "change_over_s: "),
    ({}, ""),
    ({"over_s": 1.0}, ""),
    ({"gamma": 0.3, "over_s": -1.0}, "over_s: "),
    ({"gamma": 0.3, "beta": -1.0}, "beta: "),
    ({"": 0.3}, ""),
]


@pytest.mark.parametrize(("request_", "problem"), BAD)
def test_what_is_wrong_is_named_and_nothing_has_changed(request_, problem):
    controller = controller_case("qp12", None).make()
    before = controller.changeable()
    with pytest.raises(UsageError) as refused:
        controller.change(request_)
    assert problem in str(refused.value)
    assert controller.changeable() == before
    state = resting(controller)
    touched, untouched = controller.step(state).values.copy(), controller_case("qp12", None).make()
    untouched.reset(state, None)
    assert (untouched.step(state).values == touched).all()


OTHERS = [
    ("clik_ur5", {"tasks.unknown.weight": 2.0}, "tasks.unknown"),
    ("clik_ur5", {"tasks.hand": 2.0}, "tasks.hand"),
    ("clik_ur5", {"tasks.hand.parameters.weights": [1.0, 2.0]}, "weights"),
    ("clik_ur5", {"tasks.hand.parameters.weights": [0.0]}, "weights"),
    ("clik_ur5", {"tasks.hand.gain_per_s": 1000.1}, "gain_per_s.*1000"),
    ("ghc", {"null_damping_per_s": 0.0}, "null_damping_per_s"),
    ("ghc", {"tasks.hand.kp": 0.0}, "tasks.hand.kp"),
    ("ghc", {"tasks.0.kp": 0.0}, "tasks.hand.kp"),
    ("ghc", {"bounds.speed_share": 1e-9}, "bounds"),
    ("stable_qp_hoap3", {"constraints.support_polygon.parameters.eta_per_s": 1e6}, "eta_per_s"),
]


@pytest.mark.parametrize(("law", "request_", "problem"), OTHERS)
def test_a_change_is_refused_that_a_config_would_be(law, request_, problem):
    controller = controller_case(law, None).make()
    before = controller.changeable()
    with pytest.raises(UsageError, match=problem):
        controller.change(request_)
    assert controller.changeable() == before


@pytest.mark.parametrize(
    "request_",
    [
        {"tasks.hand.gain_per_s": 2.0, "tasks.0.gain_per_s": 3.0},
        {"tasks": {"0": {"gain_per_s": 2.0}, "hand": {"gain_per_s": 3.0}}},
    ],
)
def test_two_keys_of_one_number_are_refused_and_both_named(request_):
    controller = controller_case("clik_ur5", None).make()
    before = controller.changeable()
    with pytest.raises(UsageError) as refused:
        controller.change(request_)
    assert "tasks.hand.gain_per_s" in str(refused.value)
    assert "tasks.0.gain_per_s" in str(refused.value)
    assert controller.changeable() == before


@pytest.mark.parametrize(
    ("law", "request_"),
    [
        ("ghc_velocity", {"set": [["foot", "com", 0.5]], "tasks.foot.gain_per_s": 3.0}),
        ("ghc", {"order": ["hand", "posture"], "tasks": {"hand": {"kp": 40.0}}, "over_s": 1.0}),
        ("weighted", {"weights": {"hand": 2.0}, "w_r": 1e-3}),
    ],
)
def test_numbers_do_not_change_together_with_priorities_or_weights(law, request_):
    controller = controller_case(law, None).make()
    before = controller.changeable()
    with pytest.raises(UsageError):
        controller.change(request_)
    assert controller.changeable() == before


def test_a_task_that_is_known_by_its_class_changes_by_that_name():
    case = controller_case("clik_ur5", None)
    name = "hoap3.remote_controller.tasks.posture:PostureTask"
    tasks = [{"task": name, "gain_per_s": 1.0}]
    controller = built(case, with_parameters(case.config, tasks=tasks))
    key = f'tasks."{name}".gain_per_s'
    assert key in {each["key"] for each in controller.numbers()}
    controller.change({key: 2.0})
    controller.change({"tasks": {name: {"gain_per_s": 3.0}}})
    with pytest.raises(UsageError, match=re.escape(key)):
        controller.change({key: -1.0})


def test_a_limit_of_speed_that_others_reckon_with_is_only_lowered():
    case = controller_case("ghc", None)
    limits = [{"constraint": "joint_velocity", "parameters": {"limit_rad_s": 1.0}}]
    controller = built(case, with_parameters(case.config, constraints=limits))
    controller.change({"constraints.joint_velocity.parameters.limit_rad_s": 0.5})
    with pytest.raises(UsageError, match="limit_rad_s"):
        controller.change({"constraints.joint_velocity.parameters.limit_rad_s": 1.5})


def resting(controller: Any) -> State:
    """The first State of its robot."""
    description = controller.description
    state = State.allocate(**description.state_lengths)
    state.mode, state.tick = State.ACTIVE, 1
    state.q[:] = state.reference[:] = description.initial_position
    controller.reset(state, None)
    return state


class Steady(VelocityController):
    """Of somebody else: a constant velocity, in one line changeable."""

    class Parameters(VelocityController.Parameters):
        """How fast."""

        speed_rad_s: float = Field(
            0.001, ge=-0.01, le=0.01, description="of joint 1", json_schema_extra=CHANGEABLE
        )

    def velocity(self, state: State) -> Any:
        del state
        u = np.zeros(self.description.n)
        u[0] = self.parameters.speed_rad_s
        return u


def test_a_declared_number_of_ones_own_moves_by_the_cosine():
    controller = Steady(load("hoap3"), Steady.Parameters())
    state = resting(controller)
    controller.change({"speed_rad_s": 0.003, "over_s": 0.01})
    found = []
    for tick in range(2, 14):
        state.tick = tick
        found.append(controller.step(state).decision[0])
    gone = np.minimum(np.arange(1, 13) / 10.0, 1.0)
    wanted = 0.001 + 0.002 * (0.5 - 0.5 * np.cos(np.pi * gone))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-15)
    assert found[-1] == 0.003


class Limited(Steady):
    """The same within a limit, which it keeps in a form of its own."""

    class Parameters(Steady.Parameters):
        """And how fast at most."""

        limit_rad_s: Annotated[float | None, Unset(lambda own, _: 2.0 * own.speed_rad_s)] = Field(
            None, gt=0, description="of joint 1", json_schema_extra=CHANGEABLE
        )

    def __init__(self, description: Any, parameters: Any) -> None:
        super().__init__(description, parameters)
        self.apply(parameters)

    def apply(self, parameters: Any) -> None:
        """Read the limit; no more than 0.008."""
        self.applied = parameters.limit_rad_s, parameters.speed_rad_s
        if (parameters.limit_rad_s or 0.0) > 0.008:
            raise ConfigError("", "limit_rad_s", parameters.limit_rad_s, "is too high", "Less")


def test_what_apply_refuses_leaves_the_present_numbers_applied():
    controller = Limited(load("hoap3"), Limited.Parameters())
    resting(controller)
    with pytest.raises(UsageError, match="limit_rad_s"):
        controller.change({"limit_rad_s": 0.009, "speed_rad_s": 0.002})
    assert controller.applied == (None, 0.001)
    controller.change({"limit_rad_s": 0.004, "speed_rad_s": 0.002})
    assert controller.applied == (None, 0.001)


def test_a_number_that_is_null_sets_out_from_what_it_stands_for():
    controller = Limited(load("hoap3"), Limited.Parameters())
    state = resting(controller)
    controller.change({"limit_rad_s": 0.004, "over_s": 0.002})
    for state.tick in (2, 3):
        controller.step(state)
        wanted = 0.003 if state.tick == 2 else 0.004
        assert controller.applied == (pytest.approx(wanted, abs=1e-15), 0.001)


def test_a_change_on_the_way_sets_out_from_where_the_number_is():
    controller = Steady(load("hoap3"), Steady.Parameters())
    state = resting(controller)
    controller.change({"speed_rad_s": 0.009, "over_s": 0.01})
    for tick in range(2, 7):
        state.tick = tick
        half = controller.step(state).decision[0]
    controller.change({"speed_rad_s": -0.009, "over_s": 0.01})
    state.tick = 7
    assert 0.9 * half < controller.step(state).decision[0] < half


def test_a_jump_is_no_greater_than_is_configured_however_soon_it_is_asked_for():
    controller = Steady(load("hoap3"), Steady.Parameters(change_jump_rad_s=1e-3))
    state = resting(controller)
    last = controller.step(state).decision[0]
    controller.change({"speed_rad_s": 0.009, "over_s": 0.0})
    held = 0
    for tick in range(2, 60):
        state.tick = tick
        now = controller.step(state).decision[0]
        assert abs(now - last) <= 1e-3 * (1.0 + 1e-9)
        held += controller.present != 0
        last = now
    assert last == 0.009
    assert held > 0


class Unsure(Steady):
    """The same; it has no answer to a posture that is no number."""

    def velocity(self, state: State) -> Any:
        return np.full(state.q.size, np.nan) if np.isnan(state.q[0]) else super().velocity(state)


def test_an_answer_that_was_no_number_lets_no_jump_pass():
    controller = Unsure(load("hoap3"), Unsure.Parameters(change_jump_rad_s=1e-3))
    state = resting(controller)
    last = controller.step(state).decision[0]
    place = state.q[0]
    controller.change({"speed_rad_s": 0.009, "over_s": 0.0})
    for state.tick, state.q[0] in ((2, np.nan), (3, place), (4, np.nan), (5, place)):
        now = controller.step(state).decision[0]
        if not np.isnan(now):
            assert abs(now - last) <= 1e-3 * (1.0 + 1e-9)
            last = now


def test_a_damping_that_follows_another_gain_is_no_goal():
    case = controller_case("joint_acceleration", None)
    controller = built(case, with_parameters(case.config, kp=100.0, kd=20.0))
    with pytest.raises(UsageError, match="kd"):
        controller.change({"kp": 400.0, "kd": None})
    following = built(case, with_parameters(case.config, kp=100.0, kd=None))
    state = resting(following)
    following.change({"kp": 400.0, "kd": None, "over_s": 0.01})
    for state.tick in range(2, 20):
        following.step(state)
        kp = following.parameters.kp
        np.testing.assert_allclose(following._gains, [kp, 2.0 * np.sqrt(kp)], rtol=1e-15)
    assert kp == 400.0


def test_a_change_that_is_held_back_is_repeated_and_true():
    case = controller_case("qp12", None)
    config = with_parameters(case.config, gamma=0.2, ramp_s=0.1, change_jump_rad_s=2e-4)
    request = {"gamma": 0.97, "over_s": 0.01}
    done = simulate(case.emulator, config, 0.25, steer=asking({TICK * 2: request}))
    run = next(iter(runs(done.records)))
    assert len(run.conditions) > 1
    assert replay_records(done.records, config, file="qp12").identical
    assert not judged(config, done).false
