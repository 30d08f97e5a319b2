"""The mathematics of velocity controllers in `verify`, beside the product's own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from driven import recorded
from support.checked_answers import check_answers

from hoap3.protocol.config.settings import parse
from hoap3.remote_controller.constraints.joints.viability_kernels import velocity_bounds as kernel
from hoap3.remote_controller.problems import clik_sdp, ghc_velocity, velocity
from hoap3.remote_controller.problems.check import check_problem
from hoap3.remote_controller.problems.ghc import (
    Condensed,
    Projectors,
    Values,
    Wanted,
    condensed,
    program_of,
)
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import stopping_speed
from hoap3.remote_controller.problems.oracles.parameters import NOT_READ, UnverifiableError
from hoap3.remote_controller.problems.parameters_in_force import OF_CHANGES
from hoap3.remote_controller.problems.schedule import Priorities, top_tasks
from hoap3.remote_controller.problems.velocity import velocity_bounds
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.scheduling import priorities as scheduling
from hoap3.remote_controller.scheduling.priorities import PrioritySettings, top_level
from hoap3.remote_controller.solvers.ghc import reference as ghc_reference

SIZES, EDGES, ROWS = [3, 2], [0, 3, 5], [slice(0, 3), slice(3, 5)]


def jacobians(number: int = 6, n: int = 7, seed: int = 1) -> np.ndarray:
    """Some of them with a task that depends on another."""
    J = np.random.default_rng(seed).normal(size=(number, 5, n))
    J[1, 4] = J[1, 0] + J[1, 3]
    J[2, 3] = J[2, 1]
    return J


def test_bounds_of_velocities_are_those_of_the_product() -> None:
    random = np.random.default_rng(4)
    limits = np.array([[-1.0] * 5, [1.0] * 4 + [np.inf], [3.0] * 5, [40.0] * 5])
    q = random.uniform(-1.0, 1.0, (400, 5))
    q[:50, 0] = 1.0 - 10.0 ** random.uniform(-12, -1, 50)
    q[50:60, 1] = [1.0] * 10
    v = random.uniform(-4.0, 4.0, (400, 5))

    found = velocity_bounds(q, v, limits, 1e-3)

    for k in range(400):
        lower, upper = np.zeros((2, 5))
        kernel(q[k].copy(), v[k].copy(), limits, 1e-3, lower, upper)
        np.testing.assert_allclose([found[0][k], found[1][k]], [lower, upper], rtol=1e-12)


@pytest.mark.parametrize("width", [0.0, 0.3])
def test_the_hierarchy_is_condensed_as_by_the_reference(width: float) -> None:
    J, random = jacobians(), np.random.default_rng(5)
    b = random.normal(size=(6, 5))
    alpha = np.array([np.array([[0.0, a], [1.0, 0.0]]) for a in (0.0, 0.2, 1.0, 0.5, 0.0, 0.0)])

    for k in range(6):
        found = condensed(Wanted(J[k], b[k], np.zeros(5), EDGES), alpha[k], 1e-3, width)
        parts = [J[k, rows] for rows in ROWS], [b[k, rows] for rows in ROWS]
        S, q0 = ghc_reference.condensed(*parts, alpha[k], 1e-3, width)
        np.testing.assert_allclose(found.S, S, rtol=1e-9, atol=1e-9 * np.abs(S).max())
        np.testing.assert_allclose(found.q0, q0, atol=1e-9)
        for i in range(2):
            P = ghc_reference.projector(np.repeat(alpha[k, i], SIZES), J[k], width)
            ours = Projectors(J[k], EDGES, width).of(alpha[k, i])
            np.testing.assert_allclose(ours, P, atol=1e-9)


def test_the_optimum_of_the_reference_solves_the_program_and_no_other_point_does() -> None:
    J, b = jacobians()[3:], np.random.default_rng(6).normal(size=(3, 5))
    alpha, none, one = np.array([[0.0, 0.0], [1.0, 0.0]]), np.zeros(7), np.eye(7)

    def holds(u: np.ndarray, given: Condensed, limit: np.ndarray) -> bool:
        values = Values(u, none, -limit, limit), Values(u, none, none - np.inf, none + np.inf)
        program = program_of(given, 0.0, one, none, none, *values, none).problem
        return all(each.holds for each in check_problem(program, u, none))

    for k in range(3):
        given = condensed(Wanted(J[k], b[k], np.zeros(5), EDGES), alpha, 1e-2, 0.0)
        limit = np.full(7, 0.5 * np.abs(given.q0).max())
        G, h = np.vstack([one, -one]), -np.tile(limit, 2)
        best = ghc_reference.optimum(given.S, given.q0, 0.0, 0.0 * one, none, G, h)
        assert best is not None
        u = np.clip(best[0], -limit, limit)
        assert holds(u, given, limit)
        u[(limit - np.abs(u)).argmax()] += 1e-6
        assert not holds(u, given, limit)


TIMELINE = [
    {"at_s": 0.1, "over_s": 0.2, "order": ["c", "a"]},
    {"at_s": 0.4, "remove": "b", "over_s": 0.1},
    {"at_s": 0.6, "set": [["a", "c", 0.25]]},
    {"at_s": 0.7, "insert": ["b"], "over_s": 0.05},
]
LIVE = {250: {"set": [["a", "b", 0.3], ["b", "a", 0.9]], "over_s": 0.07}, 820: {"remove": "c"}}


@pytest.mark.parametrize(
    "start",
    [
        {"order": ["a", ["b", "c"]]},
        {"matrix": [[0.0, 0.5, 1.0], [0.25, 0.0, 0.0], [1.0, 1.0, 0.0]], "inactive": []},
    ],
)
@pytest.mark.parametrize("live", [{}, LIVE])
def test_priorities_move_as_those_of_the_product(start: dict, live: dict) -> None:
    content = {**start, "timeline": TIMELINE}
    parsed = parse(PrioritySettings, content, "x.yaml", "priorities")
    theirs = scheduling.Priorities(("a", "b", "c"), parsed)
    ours = Priorities(["a", "b", "c"], content)
    now, alpha = 0.0, ours.goal
    for tick in range(1000):
        if tick in live:
            theirs.change(live[tick], now)
            ours.change(live[tick], now)
        now = tick * 1e-3
        changed = theirs.update(now)
        before, alpha = alpha, ours.at(now)
        np.testing.assert_allclose(alpha, theirs.alpha, rtol=0, atol=1e-14)
        assert ((alpha != before).any(), ours.under_way) == (changed, theirs.moving), tick
        assert top_tasks(alpha).tolist() == top_level(theirs.alpha).tolist()


@pytest.mark.parametrize(
    "wrong",
    [
        {"order": ["a", "unknown"]},
        {"matrix": [[0.0, 2.0], [0.0, 0.0]]},
        {"matrix": [[0.0]]},
        {"timeline": [{"order": ["a", "b"]}]},
    ],
)
def test_priorities_that_cannot_be_read_say_so(wrong: dict) -> None:
    with pytest.raises(NOT_READ):
        Priorities(["a", "b"], wrong)


def test_a_change_of_tasks_that_are_none_says_so() -> None:
    with pytest.raises(UnverifiableError):
        Priorities(["a", "b"], {}).change({"order": ["a", "unknown"]}, 0.0)


def test_defaults_are_those_of_the_controllers_and_no_other_setting_changes_a_claim() -> None:
    no_claim = {"budget", *OF_CHANGES}
    weight, gain = {"weight": clik_sdp.WEIGHT}, {"gain_per_s": clik_sdp.GAIN_PER_S}
    ours = {
        "clik": (clik_sdp.ClikProblems.defaults, weight | gain),
        "clik_sdp": (clik_sdp.ClikSdpProblems.defaults, weight),
        "ghc_velocity": (
            ghc_velocity.GhcVelocityProblems.defaults,
            {"gain_per_s": ghc_velocity.GAIN_PER_S},
        ),
    }
    for name, (own, of_tasks) in ours.items():
        fields = find(name).Parameters.model_fields
        assert set(fields) <= {*velocity.DEFAULTS, *own, *no_claim}, name
        for key, usual in {**velocity.DEFAULTS, **own}.items():
            if key in {"bounds", "priorities"}:
                assert usual == {}
            elif fields[key].is_required():
                assert key == "tasks"
            else:
                first = usual[0] if isinstance(usual, tuple) else usual
                assert fields[key].default == first, (name, key)
        assert fields["bounds"].default.margin_rad == velocity.MARGIN_RAD
        task = fields["tasks"].annotation
        while not hasattr(task, "model_fields"):
            task = task.__args__[0]
        for key, usual in of_tasks.items():
            assert task.model_fields[key].default == usual, (name, key)


def test_a_stopping_speed_comes_to_rest_within_the_room() -> None:
    A, T = 40.0, 1e-3
    for room in (1e-9, 3e-5, 0.01, 0.7):
        w = float(stopping_speed(np.array(room), np.array(A), T))
        steps = np.maximum(w - A * T * np.arange(10_000), 0.0)
        assert steps.sum() * T == pytest.approx(room, rel=1e-9)
        assert all(a - b <= A * T * (1 + 1e-9) for a, b in pairwise(steps))


ADAPTIVE = {"gamma": 0.3, "adaptive_gamma": True}
CENTIMETRES = {"error_unit": "cm", **ADAPTIVE, "gamma_slope": 5e-3, "ramp_s": 0.0}
SLOPED = {"kind": "qp12", **ADAPTIVE, "gamma_slope": 1e4}


def false_claims(name, records, parameters):
    claims = check_answers(records, name, parameters)
    assert claims.checked > 0
    return {claim for claim, count in claims.counts.items() if count.false}


@pytest.fixture(scope="module", params=["qp12", "osqp"])
def centimetres(request):
    return request.param, *recorded(request.param, "hoap3", 80, **CENTIMETRES)


def test_what_was_answered_in_centimetres_is_true(centimetres):
    assert false_claims(*centimetres) == set()


@pytest.mark.parametrize(
    ("change", "claim"),
    [({"error_unit": "m"}, "required V rate"), ({"gamma_slope": 100.0}, "residual")],
)
def test_another_unit_or_slope_is_found(centimetres, change, claim):
    name, records, parameters = centimetres
    assert claim in false_claims(name, records, {**parameters, **change})


def test_the_slope_of_stable_qp_is_used():
    records, given = recorded("stable_qp", "hoap3", 80, objective=SLOPED, psi={"form": "one"})
    assert check_answers(records, "stable_qp", given).by_tick() == []
    other = {**given, "objective": {**SLOPED, "gamma_slope": 10.0}}
    assert check_answers(records, "stable_qp", other).counts["optimum"].false
