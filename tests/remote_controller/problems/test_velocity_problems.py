"""The problems of `clik`, `clik_sdp` and `ghc_velocity`: true answers hold, changed ones fail."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.problems.check import check, check_problem
from hoap3.remote_controller.problems.gain_program import gap_of
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.statement import GainProgram
from hoap3.remote_controller.problems.velocity import velocity_bounds
from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.sdp.sdp_reference import optimum
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import BUILDERS, check_statements
from hoap3.tools.verify.statements import builder_of as builder_class

sys.path.append(str(Path(__file__).parents[2] / "tools" / "verify"))
from driven import recorded

RUNS: dict[str, tuple[str, str, str | None]] = {
    "clik_sdp": ("clik_sdp", "ur5", None),
    "ur5": ("clik_sdp_ur5", "ur5", "outstretched"),
    "writing": ("clik_sdp_writing", "ur5", "outstretched"),
    "hoap3": ("clik_sdp_hoap3", "hoap3", None),
    "humanoid": ("clik_sdp_humanoid", "humanoid32", None),
    "clik": ("clik_ur5", "ur5", "outstretched"),
    "ghc_velocity": ("ghc_velocity", "hoap3", None),
    "ranks": ("ghc_velocity", "hoap3", None),
    "at bounds": ("ghc_velocity", "hoap3", None),
}
SDP = [name for name, (config, *_) in RUNS.items() if config.startswith("clik_sdp")]
RANKS: dict[str, Any] = {
    "priorities": {
        "order": ["com", "foot", "posture"],
        "timeline": [
            {"at_s": 0.02, "over_s": 0.01, "set": [["foot", "posture", 1.0]]},
            {"at_s": 0.05, "remove": "foot"},
            {"at_s": 0.07, "insert": "foot", "over_s": 0.02},
        ],
    },
    "changes": {
        15: {"set": [["com", "posture", 0.5]], "over_s": 0.004},
        100: {"order": ["posture", "com"], "over_s": 0.01},
        120: {"tasks": {"com": {"gain_per_s": 4.0}}, "over_s": 0.02},
        150: {"regularisation": 1e-4, "over_s": 0.03},
        190: {"remove": ["com"], "over_s": 0.01},
    },
}
ALL = ["com", "foot", "posture"]
GIVEN: dict[str, dict[str, Any]] = {
    "ranks": RANKS,
    "at bounds": {
        "bounds": {"acceleration_rad_s2": 1.0, "speed_rad_s": 0.1},
        "changes": {120: {"remove": ALL}, 185: {"insert": ALL, "over_s": 0.02}},
        "noise": 1e-5,
        "lost": 0.0,  # after a lost answer joints stand still
    },
}
"""What runs have beside `DISTURBED`: priorities that change, and no task to stop a motion with."""
DISTURBED: dict[str, Any] = {"lost": 0.1, "unseen": 0.05, "noise": 1e-4, "pauses": (50, 200)}
Records = tuple[list[Record], dict[str, Any]]


@cache
def run(name: str, ticks: int, seed: int = 0) -> Records:
    """A disturbed run."""
    config, robot, posture = RUNS[name]
    given = {**DISTURBED, **GIVEN.get(name, {})}
    return recorded(config, robot, ticks, posture=posture, seed=seed, **given)


def builder_of(records: list[Record], parameters: Mapping[str, Any], name: str) -> ProblemBuilder:
    """The builder of a run's problems."""
    session, config = json.loads(records[1].payload), RUNS[name][0]
    controller = max((each for each in BUILDERS if config.startswith(each)), key=len)
    kind = builder_class(controller, parameters)
    assert kind is not None
    description = RobotDescription.from_json(records[0].payload)
    return kind(description, parameters, session, controller)


def checked(records: list[Record], parameters: Mapping[str, Any], name: str) -> Claims:
    """What is found of a run."""
    claims = Claims()
    check_statements(records, builder_of(records, parameters, name), claims)
    return claims


TICKS = {"ur5": 400, "writing": 400, "hoap3": 260, "humanoid": 150}
USUAL = 300


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_disturbed_run(name: str) -> None:
    ticks = TICKS.get(name, USUAL)
    records, parameters = run(name, ticks)

    found = checked(records, parameters, name)

    assert found.by_tick() == []
    assert found.unverifiable == 0
    assert found.counts["V"].checked > 0.8 * ticks
    if name == "at bounds":
        assert found.counts["no velocity within the bounds"].checked > 20


@pytest.mark.slow
def test_a_sample_finds_what_the_whole_finds() -> None:
    """Nothing of an answer depends on whether those before it were checked."""
    records, parameters = run("writing", TICKS["writing"])
    claims = Claims()

    check_statements(records, builder_of(records, parameters, "writing"), claims, share=0.1)

    assert claims.by_tick() == []
    assert 10 < claims.counts["u"].checked < 80


SETTINGS: list[tuple[str, dict[str, Any]]] = [
    ("ur5", {"damping": 0.05}),
    ("ur5", {"kinematics_from": "reference"}),
    ("ur5", {"integrate_from": "measured"}),
    ("ur5", {"budget": 2}),
    ("ur5", {"beta_per_s": 900000.0}),
    ("writing", {"damping": 0.05}),
    ("writing", {"bounds": {"speed_rad_s": 0.5}}),
    ("clik", {"damping": 0.1}),
    ("ghc_velocity", {"smoothing": 0.0}),
    ("ghc_velocity", {"kinematics_from": "reference"}),
    ("ghc_velocity", {"integrate_from": "measured"}),
    ("ghc_velocity", {"priorities": {"order": [["posture", "com"], "foot"]}}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "settings"), SETTINGS)
def test_no_finding_with_other_settings(name: str, settings: dict[str, Any]) -> None:
    config, robot, posture = RUNS[name]
    records, parameters = recorded(config, robot, 200, posture=posture, noise=1e-5, **settings)

    assert checked(records, parameters, name).by_tick() == []


CHANGES: dict[int, dict[str, Any]] = {
    40: {"tasks": {"wrist": {"weight": 0.3}}, "over_s": 0.05},
    60: {"tasks": {"hand": {"parameters": {"weights": [1.0, 2.0, 0.5]}}}, "over_s": 0.02},
    120: {"damping": 0.01, "over_s": 0.001},
}


@pytest.mark.slow
def test_changed_parameters_count_from_their_state_and_end_with_a_reset() -> None:
    """The targets go on, and a reset restores what the config has."""
    config, robot, posture = RUNS["writing"]
    given = {"posture": posture, "noise": 1e-4, "unseen": 0.05, "pauses": (160,)}
    records, parameters = recorded(config, robot, 220, changes=CHANGES, **given)
    assert sum(record.kind == Kind.CHANGE for record in records) == len(CHANGES)

    assert checked(records, parameters, "writing").by_tick() == []

    unchanged = [record for record in records if record.kind != Kind.CHANGE]
    ticks = [each.tick for each in checked(unchanged, parameters, "writing").by_tick()]
    assert 40 <= min(ticks) <= 42
    assert max(ticks) <= 161


def larger(number: float) -> float:
    """A little larger; rounding becomes more than that."""
    return number * (1.0 + 1e-6) if abs(number) > 1e-12 else 1e-6


CHANGED: dict[str, Callable[[float], float]] = {
    "margin": lambda margin: larger(margin) + 1e-6,
    "rho": lambda rho: rho * (1.0 - 1e-6) or 1e-6,
    "kkt_residual": lambda residual: residual + 1e-5,
    "active_joints": lambda count: count + 1,
    "solver_status": lambda status: 1 if status == 0 else 0,
    "fallback": lambda fallback: 0 if fallback else 1,
    "task_rank": lambda rank: rank - 1,
    "remainder": lambda remainder: remainder + 1e-7,
}
"""How other numbers than by `larger` become others."""
SCALARS = (
    *("v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual"),
    *("active_joints", "solver_status", "fallback"),
)
UNCLAIMED = {"rank", "slack"}
"""Columns of what only the solver has: rank of its multiplier, and β of its program."""


def changed(row: Any, columns: list[str]) -> Iterator[tuple[str, Any]]:
    """The answer with each of its numbers changed, one at a time."""
    for name in SCALARS:
        if name == "kkt_residual" and row["fallback"]:
            continue  # a bound of the gap, which may be larger
        other = row.copy()
        other[name] = CHANGED.get(name, larger)(row[name])
        yield name, other
    for name in ("values", "decision", "gains", "extra"):
        for place in range(len(row[name])):
            label = columns[place] if name == "extra" else f"{name} {place}"
            if label not in UNCLAIMED:
                other = row.copy()
                other[name][place] = CHANGED.get(label, larger)(row[name][place])
                yield label, other


def holds(builder: ProblemBuilder, row: Any) -> bool:
    """Whether all that is claimed of an answer in place of the newest one is found true."""
    builder.history.answer = row
    statement = builder.problem()
    assert statement is not None
    return all(each.holds for each in check(statement))


def at_answers(records: list[Record], builder: ProblemBuilder, ticks: set[int]) -> Iterator[Any]:
    """The answers to some States, as rows, when the builder has read them."""
    for kind, _, payload in records:
        builder.feed(kind, payload)
        if kind == Kind.SETPOINT and int(builder.history.state["tick"]) in ticks:
            yield builder.history.answer


def missed(name: str, ticks: int, at: set[int]) -> list[tuple[int, str]]:
    """Changed numbers of some answers that are not found; tick and name."""
    records, parameters = run(name, ticks)
    columns = json.loads(records[1].payload)["extra"]
    builder, found, tried = builder_of(records, parameters, name), [], 0
    for row in at_answers(records, builder, at):
        assert holds(builder, row)
        for label, other in changed(row, columns):
            tried += 1
            if holds(builder, other):
                found.append((int(row["tick"]), label))
    assert tried > 20 * len(at)
    return found


@pytest.mark.parametrize("name", ["clik", "ur5", "ranks"])
def test_a_short_run_is_true_and_a_changed_one_is_not(name: str) -> None:
    assert checked(*run(name, 44), name).by_tick() == []
    assert missed(name, 44, {41}) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_each_changed_number_is_found(name: str) -> None:
    assert missed(name, TICKS.get(name, USUAL), {3, 41, 97, 140, 203}) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", SDP)
def test_gains_that_are_not_the_best_are_found(name: str) -> None:
    """Even where all that follows from them is consistent."""
    records, parameters = run(name, TICKS.get(name, USUAL))
    builder, tried = builder_of(records, parameters, name), 0
    for row in at_answers(records, builder, {3, 41, 97, 140, 203}):
        statement = builder.problem()
        assert statement is not None
        if row["fallback"]:
            continue
        program = statement.problems[0]()
        assert isinstance(program, GainProgram)
        for share in (0.9, 1.1):
            other = replace(program, gains=share * program.gains)
            found = check_problem(other, statement.answer, statement.answer_error)
            assert not all(each.holds for each in found)
            tried += 1
    assert tried >= 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ghc_velocity", "ranks"])
def test_another_velocity_is_not_the_optimum_of_the_hierarchy(name: str) -> None:
    """Even where the setpoint follows from it."""
    records, parameters = run(name, USUAL)
    builder, random = builder_of(records, parameters, name), np.random.default_rng(5)
    for row in at_answers(records, builder, {3, 41, 97, 140, 203}):
        u, moved = row["decision"], row.copy()
        moved["decision"] += 1e-6 * max(np.abs(u).max(), 1e-6) * random.normal(size=len(u))
        moved["values"] += (moved["decision"] - u) * 1e-3
        builder.history.answer = moved
        statement = builder.problem()
        assert statement is not None
        assert {"optimum", "u", "rows"} & {f.name for f in check(statement) if not f.holds}


@pytest.mark.parametrize("limit", [9.0, 0.05])
def test_the_gap_is_0_at_the_optimum_and_elsewhere_what_is_lost(limit: float) -> None:
    random, weights = np.random.default_rng(3), np.array([4.0, 4.0, 4.0, 1.0, 1.0])
    dt, delta = 0.01, 5e-5
    for _ in range(3):
        B, L = prioritised([3, 2], random.normal(size=(5, 7)), weights)
        S, most = B * random.normal(size=5), limit * np.ones(7)
        gains, beta, proved = optimum(L, S, -most, most, dt, delta)
        assert proved
        best = GainProgram(L, S, -most, most, 0.0 * most, dt, delta, gains, 0.0)
        assert gap_of(best, 1e-12) < 1e-12
        for share in (0.999, 0.7):
            other = share * gains
            worse = (certified(L, other, dt) - 1.0) ** 2 + delta * other @ other
            worse -= (beta - 1.0) ** 2 + delta * gains @ gains
            gap = gap_of(replace(best, gains=other), 1e-10)
            assert worse - 1e-10 <= gap <= 1.1 * worse + 1e-9


def test_velocity_bounds_let_a_joint_stop_before_the_end_of_its_range() -> None:
    limits, T = np.array([[-1.0], [1.0], [3.0], [40.0]]), 1e-3
    q, v = np.zeros(1), np.zeros(1)
    for _ in range(1000):
        _, v = velocity_bounds(q, v, limits, T)
        q = q + v * T
    assert 1.0 - 1e-9 <= q[0] <= 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"tasks": 3},
        {"tasks": [3]},
        {"tasks": [{"task": "none"}]},
        {"tasks": [{"task": "com", "weight": float("nan")}]},
        {"damping": True},
        {"bounds": {"speed_rad_s": "fast"}},
        {"tasks": [{"task": "com"}]},
    ],
)
def test_settings_that_are_not_those_of_the_log_are_refused(wrong: dict[str, Any]) -> None:
    records, parameters = run("ur5", 44)
    with pytest.raises(UnverifiableError):
        builder_of(records, {**parameters, **wrong}, "ur5")


def test_less_regularisation_than_a_config_may_have_is_refused() -> None:
    records, parameters = run("ghc_velocity", 4)
    with pytest.raises(UnverifiableError, match="regularisation"):
        builder_of(records, {**parameters, "regularisation": 0.9e-6}, "ghc_velocity")


@pytest.mark.slow
def test_of_delayed_answers_only_errors_are_compared() -> None:
    records, parameters = run("ur5", TICKS["ur5"])
    description = json.loads(records[0].payload) | {"delay_ticks": 2}
    delayed = [records[0]._replace(payload=json.dumps(description).encode()), *records[1:]]

    found = checked(delayed, parameters, "ur5")

    assert found.by_tick() == []
    assert sum(found.counts["u"].unverified.values()) == found.counts["error"].checked > 300
    with pytest.raises(UnverifiableError, match="delayed"):
        builder_of(delayed, {**parameters, "kinematics_from": "reference"}, "ur5")


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_no_finding_in_a_long_run(name: str) -> None:
    config, robot, posture = RUNS[name]
    disturbed = {**DISTURBED, **GIVEN.get(name, {}), "pauses": (50, 200, 4_000, 11_000)}
    records, parameters = recorded(config, robot, 20_000, posture=posture, **disturbed)
    begin = time.process_time()

    found = checked(records, parameters, name)

    cycles = found.counts["V"].checked
    print(f"{name}: {1e3 * (time.process_time() - begin) / cycles:.2f} ms a cycle, {cycles} cycles")
    assert found.by_tick() == []
