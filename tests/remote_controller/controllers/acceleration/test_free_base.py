"""Controllers of a free base: their answers against mechanics, a whole QP, and lost contacts."""

from typing import Any

import daqp
import numpy as np
import pytest
from scipy.optimize import nnls

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.model.frame_dynamics import FrameRows
from hoap3.remote_controller.model.free_dynamics import BASE, FreeDynamics
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.solvers.contact.wrench_cone import cone_edges, wrench_units
from hoap3.robot_emulator.robots import load

TASKS: list[dict[str, Any]] = [
    {"name": "balance", "task": "com", "kp": 36.0, "kd": 15.0, "parameters": {"frame": "r_sole"}},
    {
        "name": "upright",
        "task": "frame_orientation",
        "kp": 100.0,
        "parameters": {"frame": "pelvis"},
    },
]
POSTURE: dict[str, Any] = {"name": "posture", "task": "posture", "kp": 40.0}
ORDER = {"order": ["balance", "upright", "posture"]}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "tsid": {"posture": {"kp": 40.0, "weight": 0.1}},
    "ghc": {"tasks": [*TASKS, POSTURE], "priorities": ORDER, "w_r": 1e-4},
    "hqp": {"tasks": [*TASKS, POSTURE], "priorities": ORDER},
    "weighted": {"tasks": [*TASKS, POSTURE], "w_r": 1e-4},
}
FRICTION, MARGIN = 0.6, 0.004
CONTACTS = {"friction": FRICTION, "margin_m": MARGIN, "least_share": 0.0}
X, Y = 0.054 - MARGIN, 0.0365 - MARGIN
CORNERS = [[X, Y], [-X, Y], [-X, -Y], [X, -Y]]
WEIGHT = 9.81 * 8.8024  # N


def free_robot(**changes: Any) -> RobotDescription:
    arrays = {"base": 13, "contact": 12}
    kinds = ("torque",)
    robot = load("hoap3").model_copy(update={"command_kinds": kinds, "state_arrays": arrays})
    return robot.model_copy(update=changes)


def controller(name: str, robot: RobotDescription, **changes: Any) -> Any:
    given = {"base": "free", "contacts": CONTACTS, "tasks": TASKS, **CONTROLLERS[name], **changes}
    law = find(name, "config", "controller")
    return law.configured(robot, parse(law.Parameters, given, "config"), "config")


def soles_of(robot: RobotDescription) -> FreeDynamics:
    return FreeDynamics(robot, [FrameRows("r_sole", 0, 6), FrameRows("l_sole", 6, 6)], 12)


def at_rest(robot: RobotDescription) -> State:
    """On both soles, the right one at the world's origin."""
    state, dynamics = State(robot.n, base=13, contact=12), soles_of(robot)
    state.q[:] = state.reference[:] = robot.initial_position
    place, axes = dynamics.placement(state.q, "r_sole")
    assert np.allclose(axes, np.eye(3), atol=1e-9)
    state.base[:3], state.base[6] = -place, 1.0
    state.contact[2::6] = 0.5 * WEIGHT
    return state


def disturbed(robot: RobotDescription) -> State:
    """Moving, with soles that hardly do."""
    state, random = at_rest(robot), np.random.default_rng(5)
    state.dq[6:10] = random.normal(size=4) * 0.5
    state.dq[16:] = random.normal(size=5) * 0.5
    return state


def parts(law: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """v̇, τ and w of the last answer."""
    n = law.description.n
    found = np.split(law.command.decision, [BASE + n, BASE + 2 * n])
    return found[0], found[1], found[2]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_answers_are_motions_that_ground_and_motors_allow(name):
    robot = free_robot()
    law, state, dynamics = controller(name, robot), disturbed(robot), soles_of(robot)
    law.reset(state, None)
    command = law.step(state)
    motion, tau, wrench = parts(law)
    assert command.fallback == 0
    dynamics.base[:] = state.base
    dynamics.update(state.q, state.dq)
    damping = np.concatenate([np.zeros(BASE), dynamics.damping])
    force = (dynamics.mass + 1e-3 * np.diag(damping)) @ motion + dynamics.bias
    force += damping * dynamics.velocity - dynamics.jacobian.T @ wrench
    assert np.allclose(force, [*np.zeros(BASE), *tau], atol=1e-9 * WEIGHT)
    rest = dynamics.jacobian @ motion + dynamics.drift
    assert np.allclose(rest, -20.0 * dynamics.twist, atol=1e-9)
    assert (np.abs(tau) <= robot.effort * (1 + 1e-9)).all()
    assert np.array_equal(command.values, tau)
    units = wrench_units(CORNERS)
    for sole in (wrench[:6], wrench[6:]):
        edges = cone_edges(CORNERS, FRICTION) / units
        assert nnls(edges.T, sole / units)[1] <= 1e-8 * WEIGHT
    proved = name in {"tsid", "ghc"}
    assert (command.solver_status == STATUS["certified"]) == proved


@pytest.mark.parametrize("name", ["tsid", "ghc"])
def test_at_rest_it_holds_its_weight_and_stays(name):
    robot = free_robot()
    law, state = controller(name, robot), at_rest(robot)
    law.reset(state, None)
    law.step(state)
    motion, _, wrench = parts(law)
    assert np.abs(motion).max() < 0.1
    assert wrench[2] + wrench[8] == pytest.approx(WEIGHT, rel=1e-2)
    assert law.command.extra[1] == pytest.approx(0.0, abs=1e-12)


def test_tsid_does_what_the_whole_program_of_base_joints_and_forces_does():
    """min Σ ω|J v̇ − b|² over v̇ and forces f ≥ 0 at the corners, contacts as equations."""
    robot = free_robot()
    law, state, n = controller("tsid", robot), disturbed(robot), 21
    law.reset(state, None)
    law.step(state)
    tasks, free, dynamics = law.tasks, law._free, law.tasks.dynamics
    roots = np.sqrt(np.repeat([1.0, 1.0, 0.1], tasks.sizes))
    J, b = roots[:, None] * tasks.jacobian, roots * tasks.wanted
    soles = tasks.soles
    G = np.zeros((12, 32))
    for i in range(2):
        G[6 * i : 6 * i + 6, 16 * i : 16 * i + 16] = cone_edges(CORNERS, FRICTION).T
    width, v = n + BASE + 32, n + BASE
    equal = np.zeros((18, width))
    equal[:12, :v], equal[12:, :v] = soles, dynamics.mass[:BASE]
    equal[12:, v:] = -soles[:, :BASE].T @ G
    side = np.concatenate([-20.0 * dynamics.twist[tasks.sole_rows], -dynamics.bias[:BASE]])
    side[:12] -= dynamics.drift[tasks.sole_rows]
    torque = np.hstack([dynamics.mass[BASE:], -soles[:, BASE:].T @ G])
    H, f = np.zeros((width, width)), np.zeros(width)
    H[:v, :v], f[:v] = J.T @ J, -J.T @ b
    H += 1e-9 * np.eye(width)
    big = np.full(BASE, 1e30)
    least = np.concatenate(
        [-big, law.lower, np.zeros(32), side, -robot.effort - dynamics.bias[BASE:]]
    )
    most = np.concatenate(
        [big, law.upper, np.full(32, 1e30), side, robot.effort - dynamics.bias[BASE:]]
    )
    sense = np.zeros(width + 18 + n, np.int32)
    sense[width : width + 18] = 5
    rows = np.ascontiguousarray(np.vstack([equal, torque]))
    x, _, flag, _ = daqp.solve(H, f, rows, most, least, sense, primal_tol=1e-10)
    assert flag == 1

    def cost(motion: FloatArray) -> float:
        return float(np.sum((J @ motion - b) ** 2))

    ours, theirs = cost(free.motion), cost(x[:v])
    Z = np.vstack(
        [free._reduction.motion, free._reduction.wrench / free._reduction._units[:, None]]
    )
    start = free._reduction.motion_start, free._reduction.wrench_start / free._reduction._units
    y = Z.T @ (np.concatenate([x[:v], G @ x[v:] / free._reduction._units]) - np.concatenate(start))
    # ours is least with weight·|y − p|² added, so it is above by no more than that of theirs
    assert ours <= theirs + law._weight * np.sum((y - law._rest) ** 2) + 1e-6
    assert theirs <= ours + 1e-9 * np.sum(x**2) + 1e-6


def test_a_sole_in_the_air_is_not_relied_on_and_comes_back():
    robot = free_robot()
    law, state = controller("tsid", robot, contacts={**CONTACTS, "margin_m": 0.0}), at_rest(robot)
    law.reset(state, None)
    assert law.step(state).solver_status == STATUS["certified"]
    state.contact[8] = 0.0
    for state.tick in range(1, 15):
        command = law.step(state)
    present = [name for i, name in enumerate(law.conditions) if law.present >> i & 1]
    _, _, wrench = parts(law)
    assert "l_sole carries nothing" in present
    assert command.solver_status != STATUS["certified"]
    assert command.fallback > 0 or wrench[8] <= 0.021 * WEIGHT
    state.contact[8] = 0.5 * WEIGHT
    state.tick += 1
    assert law.step(state).solver_status == STATUS["certified"]


def test_without_any_sole_joints_brake_with_what_they_weigh():
    robot = free_robot()
    law, state = controller("ghc", robot), disturbed(robot)
    law.reset(state, None)
    law.step(state)
    state.contact[:] = 0.0
    for state.tick in range(1, 15):
        command = law.step(state)
    present = [name for i, name in enumerate(law.conditions) if law.present >> i & 1]
    assert "no sole carries the robot" in present
    assert command.fallback == 3
    assert (command.values * state.dq <= 0.0).all()
    assert np.abs(command.values[[6, 7, 8]]).max() > 0.0
    assert command.solver_status != STATUS["certified"]


@pytest.mark.parametrize(
    ("least_share", "fallback"), [(0.0, 1), (0.45, 2)], ids=["it sinks", "nothing keeps all"]
)
def test_torques_that_are_too_small_are_not_exceeded(least_share, fallback):
    robot = free_robot()
    contacts = {**CONTACTS, "least_share": least_share}
    given = {"bounds": {"torque_max": [0.05]}, "contacts": contacts}
    law, state = controller("tsid", robot, **given), at_rest(robot)
    law.reset(state, None)
    command = law.step(state)
    assert command.fallback == fallback
    assert np.abs(command.values).max() <= 0.05 * (1 + 1e-9)
    assert command.solver_status == STATUS["infeasible"]


def test_the_centre_of_mass_asks_for_no_more_than_the_soles_can_give():
    robot = free_robot()
    tasks = [{**TASKS[0], "kp": 1e4}, TASKS[1]]
    law, state = controller("ghc", robot, tasks=[*tasks, POSTURE]), at_rest(robot)
    law.reset(state, None)
    law.step(state)
    state.base[:3] += [0.0, 0.2, 0.0]  # far from where it began
    law.step(state)
    dynamics = law.tasks.dynamics
    wanted = law.tasks.wanted[:3] + dynamics.drift[:3]
    lift = 9.81 + wanted[2]
    point = dynamics.com[:2] - wanted[:2] * dynamics.com[2] / lift
    assert point[1] == pytest.approx(0.2 + 0.088 + Y, abs=1e-3)  # the outer edge of the left sole
    assert point[0] == pytest.approx(dynamics.com[0], abs=1e-3)


FIXED = load("hoap3").model_copy(update={"command_kinds": ("torque",)})


@pytest.mark.parametrize(
    ("robot", "name", "changes", "key"),
    [
        (free_robot(), "tsid", {"base": "fixed"}, "base"),
        (FIXED, "tsid", {}, "base"),
        (free_robot(soles=()), "ghc", {}, "base"),
        (free_robot(state_arrays={"base": 13, "contact": 6}), "ghc", {}, "base"),
        (free_robot(), "ghc", {"constraints": [{"constraint": "support_polygon"}]}, "constraints"),
        (free_robot(), "hqp", {"contacts": {"margin_m": 0.04}}, "contacts.margin_m"),
    ],
)
def test_what_does_not_go_together_is_refused_with_its_key(robot, name, changes, key):
    with pytest.raises(ConfigError) as caught:
        controller(name, robot, **changes)
    assert caught.value.key == f"parameters.{key}"


def test_a_controller_without_contacts_refuses_a_free_base():
    law = find("ghc_torque", "config", "controller")
    given = {"base": "free", "tasks": [POSTURE]}
    with pytest.raises(ConfigError, match="contacts"):
        law.configured(free_robot(), parse(law.Parameters, given, "config"), "config")


@pytest.mark.parametrize("turn", [[0, 0, 0, 0], [0, np.nan, 0, 1], [0, 0, 0, 1.1]])
def test_a_state_without_a_base_is_refused(turn):
    robot = free_robot()
    law, state = controller("tsid", robot), at_rest(robot)
    law.reset(state, None)
    law.step(state)
    state.base[3:7] = turn
    assert law.step(state).solver_status == STATUS["infeasible"]
    assert np.isnan(law.command.values).all()
