"""Tasks and constraints of users: their problems are verified, and wrong derivatives are found."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tampering import SETPOINT, changed_field, config_of, ran, rewrite

from hoap3.tools.verify.verify import Verification, verify

TICK = 50
CODE = """
import math

import numpy as np

from hoap3 import ErrorTask
from hoap3.remote_controller.constraints.barrier import Barrier


class Reach(ErrorTask):
    unit = "m"
    ends, length = ("tool0", "base"), 0.6

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n, 1)
        self.frame, self.base = map(kinematics.frame_id, self.ends)
        self.p, self.rotation, self.twist = np.zeros(3), np.eye(3), np.zeros((6, description.n))

    def evaluate(self, kinematics, time_s):
        kinematics.frame(self.frame, self.base, self.p, self.rotation, self.twist)
        distance = math.hypot(*self.p)
        self.error[0] = distance - self.length - 0.02 * math.sin(3.0 * time_s)
        np.matmul(self.p, self.twist[:3], out=self.jacobian[0])
        self.jacobian /= distance
        self.error_rate[0] = -0.06 * math.cos(3.0 * time_s)


class Turned(Reach):  # wrong only after 0.05 s: what is wrong at first is refused before a run
    def evaluate(self, kinematics, time_s):
        super().evaluate(kinematics, time_s)
        if 0.0495 < time_s < 0.2:
            self.jacobian *= -1.0


class Standing(Reach):
    def evaluate(self, kinematics, time_s):
        super().evaluate(kinematics, time_s)
        if 0.0495 < time_s < 0.2:
            self.error_rate[0] = 0.0


class Elbow(Turned):
    ends, length = ("r_forearm", "pelvis"), 0.13


class Broken(Reach):
    @property
    def followed(self):
        raise AttributeError("not here")


class Height(Barrier):
    sign = 1.0

    def __init__(self, parameters, description, kinematics, period_s):
        super().__init__(parameters, description, kinematics, period_s)
        self.name_rows(("height",))
        self.frame = kinematics.frame_id(description.base_frame)
        self.position, self.jacobian = np.zeros(3), np.zeros((3, description.n))

    def look(self, kinematics, margins_out, A_out):
        kinematics.com(self.frame, self.position, self.jacobian)
        margins_out[0] = self.position[2] - 0.28
        np.multiply(self.jacobian[2], -self.sign, out=A_out[0])


class Upwards(Height):
    sign = -1.0
"""
TASK = "controller: {controller}\nrobot: ur5\nparameters:\n  {tasks}\n"
TASKS = {
    "stable_qp": 'task: {task: "own_parts:Reach"}',
    "clik": 'tasks: [{task: "own_parts:Reach"}]',
    "ghc": 'tasks: [{task: "own_parts:Reach"}]',
}
OTHERS = ("clik", "ghc")
STANDING = """
controller: ghc
robot: hoap3
parameters:
  base: free
  contacts: {friction: 0.7}
  w_r: 1.0e-4
  tasks:
    - {name: balance, task: com, parameters: {frame: r_sole}}
    - {name: elbow, task: "own_parts:Elbow", kp: 1.0}
    - {name: posture, task: posture}
  priorities: {order: [balance, elbow, posture]}
"""
SQUAT = """
controller: stable_qp
robot: hoap3
parameters:
  task: {task: com, parameters: {target: {kind: point, position_m: [0.01, 0.025, 0.27]}}}
  constraints:
    - {constraint: joint_velocity}
    - {constraint: "own_parts:Height", name: height}
"""


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Path]]:
    """The run of a config, which is made once."""
    folder, path = tmp_path_factory.mktemp("own_parts"), list(sys.path)
    (folder / "own_parts.py").write_text(CODE, encoding="utf-8")
    runs: dict[str, Path] = {}

    def run(config: str, *words: str) -> Path:
        if config not in runs:
            name = folder / f"{len(runs)}.yaml"
            name.write_text(config, encoding="utf-8")
            runs[config] = ran(folder / f"run{len(runs)}", "--controller", name, *words)
        return runs[config]

    yield run
    sys.path[:] = path
    sys.modules.pop("own_parts", None)


def found_in(path: Path, claim: str) -> Verification:
    """What `verify` finds, where this claim is false from one tick on."""
    found = verify(path, allow_code=True)
    assert found.verdict == "false"
    assert found.claims.counts[claim].first_false == TICK
    return found


@pytest.mark.parametrize(
    "controller", ["stable_qp", *(pytest.param(each, marks=pytest.mark.slow) for each in OTHERS)]
)
def test_a_task_of_ones_own_is_verified(controller, story):
    config = TASK.format(controller=controller, tasks=TASKS[controller])

    found = verify(story(config), allow_code=True)

    assert found.verdict == "true"
    assert found.claims.counts["∂e/∂q of task own_parts:Reach"].checked == 100
    without = verify(story(config))
    assert without.verdict == "not verified"
    assert "--allow-code" in next(iter(without.claims.counts["certificate"].unverified))


@pytest.mark.parametrize(("task", "claim"), [("Turned", "∂e/∂q"), ("Standing", "∂e/∂t")])
@pytest.mark.parametrize("controller", ["stable_qp", pytest.param("clik", marks=pytest.mark.slow)])
def test_a_wrong_derivative_is_found_in_its_cycle(controller, task, claim, story):
    tasks = TASKS[controller].replace("Reach", task)

    found_in(
        story(TASK.format(controller=controller, tasks=tasks)), f"{claim} of task own_parts:{task}"
    )


@pytest.mark.slow
def test_a_wrong_derivative_is_found_with_a_free_base(story):
    path = story(STANDING, "--robot", "hoap3_standing_torque")

    counts = found_in(path, "∂e/∂q of task own_parts:Elbow").claims.counts

    assert counts["∂e/∂t of task own_parts:Elbow"].checked == 100
    assert counts["∂e/∂t of task own_parts:Elbow"].false == counts["optimum"].false == 0


def test_a_task_that_raises_is_the_reason_why_it_is_not_verified(story, tmp_path):
    run = story(TASK.format(controller="stable_qp", tasks=TASKS["stable_qp"]))
    config = config_of(run).replace("own_parts:Reach", "own_parts:Broken")

    found = verify(
        rewrite(run, "controller", tmp_path / "o", list, config.encode()), allow_code=True
    )

    assert found.verdict == "not verified"
    (reason,) = found.claims.counts["certificate"].unverified
    assert "AttributeError: not here" in reason


def test_a_constraint_of_ones_own_is_verified(story):
    found = verify(story(SQUAT), allow_code=True)

    assert found.verdict == "true"
    assert found.claims.counts["∇m of constraint own_parts:Height"].checked == 100
    assert found.claims.counts["optimum"].checked == 100


def test_a_constraint_with_a_wrong_gradient_is_found(story):
    found = verify(story(SQUAT.replace("Height", "Upwards")), allow_code=True)

    assert found.claims.counts["∇m of constraint own_parts:Upwards"].false == 100


def test_a_margin_that_is_not_that_of_the_constraint_is_found(story, tmp_path):
    change = changed_field(SETPOINT, TICK, "margin", lambda margin: margin + 1e-6)

    found_in(rewrite(story(SQUAT), "controller", tmp_path / "o", change), "margin")
