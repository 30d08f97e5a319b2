"""`hoap3 verify` of `stable_qp`: true logs are true, and what is changed in them is found."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tampering import (
    ANSWERS,
    SETPOINT,
    STATE,
    Change,
    assert_no_false_alarm,
    bigger,
    changed_field,
    config_of,
    dropped,
    find_change,
    ran,
    rewrite,
)

from hoap3.remote_controller.problems import stable_qp_settings as settings
from hoap3.remote_controller.problems.oracles.parameters import complete
from hoap3.remote_controller.problems.parameters_in_force import OF_CHANGES
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

PARAMETERS = "controller.parameters."


def kept(**constraints: dict[str, Any]) -> str:
    """The setting of a list of constraints, after a limit of speeds."""
    entries = [{"constraint": name, "parameters": given} for name, given in constraints.items()]
    speed = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 1.0}}
    return "constraints=" + json.dumps([speed, *entries])


TURN = {"frame": "r_forearm", "point_m": [0, 0.01, -0.05], "normal": [1, 0.2, 0.1]}
KNEES = [1.0 if joint == 3 else -1.0 if joint == 14 else 0.0 for joint in range(21)]
NARROW = kept(support_polygon={"margin_m": 0.02})
BACKWARD = "task.parameters.direction=backward"
CASES: dict[str, tuple[str, ...]] = {
    "stable_qp": (),
    "support": (NARROW,),
    "two soles": (
        kept(support_polygon={"soles": ["r_sole", "l_sole"]}, fixed_frame={"frame": "l_sole"}),
    ),
    "ground": (kept(zmp={}, friction_cone={"mu": 0.05}), "psi.ramp_s=0"),
    "half space": (kept(half_space={**TURN, "reference": "pelvis"}),),
    "pfaffian": (kept(pfaffian={"matrix": [KNEES]}),),
    "near itself": (
        kept(distance={"clearance_m": 0.03, "contact_m": 0.03, "pairs": [["r_foot", "l_foot"]]}),
        "objective.gamma=0",
    ),
    "minimum": (kept(minimum_speed={"speed": 0.01, "joints": {"l_elbow": 1.0}, "tolerance": 0.5}),),
    "largest": ("rho=largest", "constraints.0.parameters.limit_rad_s=0.02"),
    "few": ("objective={kind: lp, p: 1}", NARROW),
    "max": ("objective={kind: lp, p: inf}", "constraints.0.parameters.limit_rad_s=0.02"),
    "squares": ("objective={kind: least_squares}",),
    "free": ("objective={kind: lp, p: 1.5}", "constraints=[]"),
    "stops": ("constraints=[{constraint: viability, parameters: {limit_rad_s2: 5}}]",),
}
STOPS = "{constraint: viability, parameters: {limit_rad_s2: 5}}"
LEANS = "{constraint: support_polygon, parameters: {margin_m: 0.005}}"


BOUNDED = """
controller: stable_qp
robot: hoap3
parameters:
  task:
    task: com
    parameters:
      frame: r_sole
      target: {kind: point, position_m: [0.01, 0.025, 0.2869]}
  objective: {kind: qp12, gamma: 0.5}
  psi: {form: max_norm, u_max_rad_s: 0.6, beta: 46.0}
  constraints:
    - constraint: joint_velocity
      parameters: {limit_rad_s: 0.6}
    - constraint: joint_position
"""


def run_of(folder: Path, *settings_: str, controller: str = "stable_qp", s: float = 0.2) -> Path:
    sets = [PARAMETERS + one for one in settings_]
    return ran(folder, "--controller", controller, sets=sets, seconds=s)


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("story")
    (folder / "bounded.yaml").write_text(BOUNDED, encoding="utf-8")
    return run_of(folder / "run", controller=str(folder / "bounded.yaml"))


def test_the_logs_of_bounded_qp12_are_true(story, tmp_path):
    assert_no_false_alarm(story)
    assert_no_false_alarm(run_of(tmp_path / "run", controller="qp12_bounded", s=1.0))


@pytest.mark.parametrize("case", CASES)
def test_a_true_log_is_true(case, tmp_path):
    found = assert_no_false_alarm(run_of(tmp_path / "run", *CASES[case]))
    assert found.claims.counts["optimum"].checked == 200


@pytest.mark.parametrize(
    ("controller", "changed"),
    [
        ("com_tracking", ()),
        ("stable_qp_hoap3", ()),
        ("obstacle", ()),
        ("com_circulation", ()),
        ("com_circulation", ("task.parameters.speed_m_s=0.3",)),  # more than the limits leave
        ("com_circulation", (BACKWARD, "objective={kind: least_squares}")),
    ],
)
def test_logs_of_other_configs_are_true(controller, changed, tmp_path):
    assert_no_false_alarm(run_of(tmp_path / "run", *changed, controller=controller, s=0.5))


@pytest.mark.long
@pytest.mark.parametrize(
    ("controller", "changed"),
    [
        ("stable_qp", ("objective={kind: lp, p: inf}", NARROW.replace("1.0", "0.02"))),
        ("com_circulation", ("task.parameters.speed_m_s=0.1", f"constraints=[{STOPS}, {LEANS}]")),
    ],
)
def test_joints_near_their_bounds_raise_no_false_alarm(controller, changed, tmp_path):
    given = "rho=largest", *changed

    found = verify(run_of(tmp_path / "run", *given, controller=controller, s=2.1))

    assert found.claims.by_tick() == []


CHANGES: dict[str, Callable[[int], Change]] = {
    **ANSWERS,
    "reference": lambda n: changed_field(STATE, n, "reference", bigger, joint=3),
    "psi": lambda n: changed_field(SETPOINT, n, "extra", bigger, joint=0),
    "drift": lambda n: changed_field(SETPOINT, n, "extra", lambda d: d + 1e-6, joint=1),
    "status": lambda n: changed_field(SETPOINT, n, "extra", lambda _: 5.0, joint=2),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_changed_is_found_at_its_tick(kind, story, tmp_path):
    number = random.Random(kind).randrange(10, 190)
    assert find_change(CHANGES[kind](number), story, "controller", number, tmp_path / "o")


@pytest.mark.long
@pytest.mark.parametrize("controller", ["qp12_bounded", "stable_qp"])
@pytest.mark.parametrize("kind", CHANGES)
def test_each_kind_of_change_is_found_at_a_hundred_places(controller, kind, tmp_path):
    run = run_of(tmp_path / "run", controller=controller, s=0.5)
    for number in random.Random(kind).sample(range(10, 490), 100):
        assert find_change(CHANGES[kind](number), run, "controller", number, tmp_path / "o")


@pytest.mark.parametrize(
    ("before", "after", "claim"),
    [
        ("beta: 46.0", "beta: 46.0001", "required V rate"),
        ("gamma: 0.5", "gamma: 0.01", "optimum"),
        ("limit_rad_s: 0.6", "limit_rad_s: 0.0200001", "certified: rows and bounds"),
        ("constraint: joint_position", "constraint: viability", "rows"),
        ("0.2869", "0.28690001", "V"),
    ],
)
def test_another_parameter_in_the_config_is_found(before, after, claim, story, tmp_path):
    config = config_of(story)
    assert before in config

    changed = config.replace(before, after).encode()
    path = rewrite(story, "controller", tmp_path / "o", list, changed)

    assert verify(path).claims.counts[claim].false


@pytest.mark.parametrize(
    "wrong",
    ["psi: {beta: .nan}", "objective: {kind: none}", "psi: 1", "unknown: 1", "rho: most"],
)
def test_a_parameter_that_is_none_is_not_reckoned_with(wrong, story, tmp_path):
    config = f"controller: stable_qp\nparameters:\n  {wrong}\n".encode()

    found = verify(rewrite(story, "controller", tmp_path / "o", list, config))

    assert found.verdict == "not verified"
    assert found.claims.counts["certificate"].checked == 0


def near_zero(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A user's function: |q|² ≤ 40."""
    return np.array([40.0 - q @ q]), -2.0 * q[None]


def test_a_constraint_that_is_not_recomputed_is_counted_by_name(tmp_path):
    mine = kept(user_function={"function": f"{__name__}:near_zero"})

    found = assert_no_false_alarm(run_of(tmp_path / "run", mine), "not verified")
    assert sum(found.claims.counts["constraint user_function"].unverified.values()) == 200


def test_a_config_without_its_constraints_is_found(story, tmp_path):
    config = config_of(story)
    text = config[: config.index("  constraints:")] + config[config.index("link:") :]

    path = rewrite(story, "controller", tmp_path / "o", list, text.encode())

    assert verify(path).claims.counts["margin"].false == 200


def test_records_that_were_dropped_are_no_false_alarm(story, tmp_path):
    assert_no_false_alarm(rewrite(story, "controller", tmp_path / "o", dropped), "not verified")


def test_answers_to_a_robot_with_a_delay_are_judged_as_far_as_can_be(tmp_path):
    run = ran(tmp_path / "run", "--controller", "stable_qp", sets=["emulator.delay_ticks=2"])

    found = assert_no_false_alarm(run, "not verified")
    assert found.claims.counts["V"].checked == 100


def test_defaults_are_those_of_the_controller():
    from hoap3.remote_controller.constraints.registry import find as find_constraint
    from hoap3.remote_controller.controllers.lyapunov_qp import settings as product
    from hoap3.remote_controller.problems.oracles.constraints.stack_oracle import KINDS
    from hoap3.remote_controller.problems.oracles.tasks import curve_oracle as curve
    from hoap3.remote_controller.tasks.curve_following.curve import JointEllipse, SpaceEllipse
    from hoap3.remote_controller.tasks.curve_following.curve_following import JointCurve, TaskCurve

    tables: list[tuple[Mapping[str, Any], Any]] = [
        (settings.DEFAULTS, product.Parameters),
        (settings.PSI, product.RateSettings),
        (settings.OBJECTIVES["qp12"], product.Qp12Objective),
        (settings.OBJECTIVES["least_squares"], product.LeastSquares),
        (settings.OBJECTIVES["lp"], product.Lp),
        (curve.SPACE, TaskCurve.Parameters),
        (curve.JOINTS, JointCurve.Parameters),
        (curve.IN_SPACE, SpaceEllipse.Parameters),
        (curve.IN_JOINTS, JointEllipse.Parameters),
        *((kind.defaults, find_constraint(name).Parameters) for name, kind in KINDS.items()),
    ]
    for ours, theirs in tables:
        assert ours.keys() == theirs.model_fields.keys() - OF_CHANGES
        needed = {key for key, value in ours.items() if not isinstance(value, type)}
        for key, value in complete({}, {key: ours[key] for key in needed}, "").items():
            default = theirs.model_fields[key].get_default(call_default_factory=True)
            if value is not None and key != "kind":  # None: a part of its own, or what robots say
                assert value == default, (theirs, key)
