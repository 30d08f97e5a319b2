"""Each figure of the certificate of `clik` and `clik_sdp`, from single cycles with linear tasks."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml, parse
from hoap3.remote_controller.config import CONFIGS, ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.clik import CONDITIONS, LASTING_S, SLOW
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains
from hoap3.robot_emulator.robots import load
from hoap3.testing import Body
from hoap3.tools.services.simulate import simulate

BOTH = pytest.mark.parametrize("kind", ["clik", "clik_sdp"])
UR5 = load("ur5")
T = UR5.period_s
START = {"robot": "ur5", "posture": "outstretched"}
BRAKES = 20.0  # rad/s²
TARGETS = (0.002, -0.001)  # so near that no bound holds it back


def controller_of(kind: str, *tasks, weights=(1.0, 1.0), **parameters):
    """One for linear tasks of a UR5, and where it begins."""
    each = [
        {"name": f"task{k}", "task": "linear_tasks:Linear", "parameters": task, "weight": weight}
        for k, (task, weight) in enumerate(zip(tasks, weights, strict=False))
    ]
    bounds = {"acceleration_rad_s2": BRAKES}
    content = {"controller": kind, "parameters": {"tasks": each, "bounds": bounds, **parameters}}
    body = Body(UR5)
    controller = build(parse(ControllerConfig, content, "mine"), UR5, "mine")
    controller.reset(body.state, None)
    return controller, body


def two(targets=TARGETS):
    """A task of the first joint, and one of the first two."""
    return (
        {"rows": [[1.0]], "target": [targets[0]]},
        {"rows": [[0.5, 1.0]], "target": [targets[1]]},
    )


def column(controller, name: str) -> float:
    return controller.command.extra[controller.extra_names.index(name)]


def holds(controller, condition: str) -> bool:
    return bool(controller.present >> controller.conditions.index(condition) & 1)


@BOTH
def test_v_its_rate_and_what_is_required_are_those_of_the_weighted_errors(kind):
    controller, body = controller_of(kind, *two(), weights=(2.0, 0.3))
    u, command = controller.velocity(body.state), controller.command
    e = np.array([0.0 - TARGETS[0], 0.0 - TARGETS[1]])
    J, w = np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([2.0, 0.3])
    assert command.v == pytest.approx(0.5 * w @ e**2, rel=1e-12)
    assert command.v_rate_predicted == pytest.approx((w * e) @ J @ u[:2], rel=1e-9)
    assert command.v_rate_predicted < 0.0
    beta = column(controller, "beta")
    assert beta > 0.0
    assert command.v_rate_required == pytest.approx(-beta * command.v, rel=1e-12)
    after = 0.5 * w @ (e + T * J @ u[:2]) ** 2
    actual = (1.0 - after / command.v) / T
    assert column(controller, "beta_actual") == pytest.approx(actual, rel=1e-6)
    assert command.solver_status == STATUS["certified"]
    assert command.rho == 1.0
    figures = [column(controller, name) for name in ("task_rank", "error_task0", "error_task1")]
    assert figures == pytest.approx([2.0, *np.abs(e)])


@BOTH
@pytest.mark.parametrize("share", [2.0, 1.0, 0.995, 0.98, 0.5, 0.0, -1.0])
def test_certified_is_only_what_falls_by_beta_where_u_leads(kind, share):
    controller, body = controller_of(kind, *two())
    begin = [0.0, 0.0]
    for place, function in enumerate(controller.functions):

        def slower(kinematics, time_s, place=place, function=function, update=function.update):
            update(kinematics, time_s)
            if time_s == 0.0:
                begin[place] = function.value
            else:  # as a curved task may have it, whatever the linear model says
                function.value = begin[place] * (1.0 - share * controller.solver.beta * T)

        function.update = slower
    controller.velocity(body.state)
    beta = column(controller, "beta")
    assert column(controller, "beta_actual") == pytest.approx(share * beta, rel=1e-6, abs=1e-9)
    proved = controller.command.solver_status == STATUS["certified"]
    assert proved == (share >= 0.99)


@BOTH
def test_what_the_bounds_make_of_an_answer_is_not_certified(kind):
    controller, body = controller_of(kind, *two())
    body.state.dq[3] = 1.0  # a joint of no task, too fast to stand in the next tick
    u = controller.velocity(body.state)
    assert u[3] == pytest.approx(1.0 - BRAKES * T, rel=1e-6)
    assert controller.solver.dq[3] == 0.0
    assert column(controller, "beta_actual") >= 0.99 * column(controller, "beta") > 0.0
    assert controller.command.solver_status == STATUS["uncertified"]
    assert controller.command.rho == 0.0
    assert holds(controller, "held by limits")


@BOTH
@pytest.mark.parametrize(
    ("targets", "arrived"),
    [
        ((0.0, 0.0), True),
        ((0.9e-5, 0.0), True),
        ((0.0, 1.1e-5), False),
        ((0.8e-5, 0.8e-5), False),
        ((1e-3, 0.0), False),
    ],
)
def test_at_target_are_all_tasks_together_within_a_hundredth_of_a_millimetre(
    kind, targets, arrived
):
    controller, body = controller_of(kind, *two(targets))
    controller.velocity(body.state)
    wanted = "at_target" if arrived else "certified"
    assert controller.command.solver_status == STATUS[wanted]
    assert (controller.command.v_rate_required == 0.0) == arrived


@BOTH
def test_margin_is_the_least_distance_of_u_from_a_bound(kind):
    controller, body = controller_of(kind, *two())
    u = controller.velocity(body.state)
    room = np.concatenate([controller.upper - u, u - controller.lower])
    assert controller.command.margin == pytest.approx(room.min(), rel=1e-12)
    assert 0.0 < controller.command.margin < BRAKES * T
    assert not holds(controller, "held by limits")


def test_what_is_required_of_gains_that_certify_nothing_is_nothing():
    ur5 = simulate(START, "clik_ur5", 0.05)
    assert (ur5.setpoints["extra"][:, ur5.controller.extra_names.index("beta")][10:] < 0.0).all()
    assert not ur5.setpoints["v_rate_required"][10:].any()


@pytest.mark.parametrize("budget", [1, 60])
def test_the_residual_is_the_gap_over_the_square_of_what_was_asked(budget):
    controller, body = controller_of("clik_sdp", *two(), budget=budget, beta_per_s=6.0)
    for _ in range(3):
        command = controller.step(body.state)
        assert command.kkt_residual == min(max(controller.solver.gap / 36.0, 0.0), 1.0)
        assert (command.kkt_residual <= 1e-9) == (budget == 60)
        assert column(controller, "slack") == controller.solver.slack
        assert (controller.solver.slack > 1e-3) == (budget == 1)  # as far as gains could do less
        assert column(controller, "rank") == controller.solver.rank
        assert (command.solver_status == STATUS["certified"]) == (budget == 60)
        body.follow(command.values)


def test_the_rate_of_v_has_the_motion_of_the_target():
    content = deepcopy(load_yaml(CONFIGS / "clik_sdp_ur5.yaml"))
    circle = {"kind": "circle", "center_m": [-0.6, -0.3, 0.5], "radius_m": 0.1, "period_s": 0.5}
    circle["approach_s"] = 0.0
    content["parameters"]["tasks"] = content["parameters"]["tasks"][:1]
    content["parameters"]["tasks"][0]["parameters"]["target"] = circle
    run = simulate(START, content, 0.2)
    V, rate = run.setpoints["v"], run.setpoints["v_rate_predicted"]
    assert run.controller.functions[0].rate > 0.3  # of V, were the hand still
    np.testing.assert_allclose(np.diff(V) / T, 0.5 * (rate[1:] + rate[:-1]), atol=0.03)


def test_the_solvers_have_what_the_config_says():
    settings = {"beta_per_s": 6.0, "delta": 1e-3, "damping": 0.2, "budget": 30}
    controller, body = controller_of("clik_sdp", *two(), weights=(2.0, 0.3), **settings)
    controller.step(body.state)
    alone = SdpGains([1, 1], UR5.n, budget=30)
    alone.weights[:], alone.damping = (2.0, 0.3), 0.2
    alone.lower[:], alone.upper[:] = controller.lower, controller.upper
    alone.solve(controller.jacobian, controller.errors, T, 6.0, 1e-3)
    assert (controller.solver.gains == alone.gains).all()
    assert controller.solver.budget == alone.budget
    assert column(controller, "beta") == alone.beta > 0.0
    steady, body = controller_of("clik", *two(), weights=(2.0, 0.3), damping=0.2)
    steady.step(body.state)
    alone = ConstantGains([1, 1], UR5.n, [1.0, 1.0])
    alone.weights[:], alone.damping = (2.0, 0.3), 0.2
    alone.solve(steady.jacobian, steady.errors, T)
    assert column(steady, "beta") == alone.beta > 0.0
    assert (steady.u == alone.dq).all()


def test_to_begin_anew_is_to_know_nothing_of_the_last_answers():
    controller, body = controller_of("clik_sdp", *two())
    for _ in range(5):
        body.follow(controller.step(body.state).values)
    assert controller.command.solver_path == 1
    fresh, begin = controller_of("clik_sdp", *two())
    begin.state.stamp_intended = body.state.stamp_intended
    for each in (controller, fresh):
        each.now = lambda: 0
        each.reset(begin.state, None)
        each.step(begin.state)
    assert controller.command.solver_path == fresh.command.solver_path == 2
    assert controller.command.dump() == fresh.command.dump()


def ask(controller, body):
    """About the next State."""
    body.state.tick += 1
    controller.velocity(body.state)


class TestSlow:
    """That β stays below a tenth of β̃ is a condition, after a while, and until it no longer is."""

    NEARLY = (
        {"rows": [[1.0]], "target": [TARGETS[0]]},
        {"rows": [[1.0, 1e-3]], "target": [TARGETS[1]]},
    )

    def test_is_said_after_a_while_and_forgotten_at_a_reset(self):
        controller, body = controller_of("clik_sdp", *self.NEARLY)
        for _ in range(2):
            said = []
            for _ in range(round(LASTING_S / T) + 5):
                ask(controller, body)
                assert 0.0 <= column(controller, "beta") < 0.4
                said.append(holds(controller, SLOW))
            assert said == [False] * round(LASTING_S / T) + [True] * 5
            controller.reset(body.state, None)

    def test_counts_states_however_often_each_is_asked_about(self):
        controller, body = controller_of("clik_sdp", *self.NEARLY)
        for _ in range(round(LASTING_S / T)):
            ask(controller, body)
            controller.velocity(body.state)
            controller.velocity(body.state)
            assert not holds(controller, SLOW)
        ask(controller, body)
        assert holds(controller, SLOW)

    def test_ends_when_beta_is_back(self):
        controller, body = controller_of("clik_sdp", *self.NEARLY)
        for _ in range(round(LASTING_S / T) + 1):
            ask(controller, body)
        assert holds(controller, SLOW)
        controller.functions[1].jacobian[0, 1] = 1.0
        ask(controller, body)
        assert column(controller, "beta") > 0.4
        assert not holds(controller, SLOW)
        controller.functions[1].jacobian[0, 1] = 1e-3
        ask(controller, body)
        assert not holds(controller, SLOW)

    @pytest.mark.parametrize(("asked", "slow"), [(39.0, False), (41.0, True)])
    def test_is_a_tenth_of_what_was_asked(self, asked, slow):
        controller, body = controller_of("clik_sdp", two()[0], beta_per_s=asked)
        controller.solve = lambda: (1, 1, 0.0, 0.0)
        controller.solver.beta = 4.0
        for _ in range(round(LASTING_S / T) + 1):
            ask(controller, body)
        assert holds(controller, SLOW) == slow

    def test_counts_no_more_than_can_be_had(self):
        controller, body = controller_of(
            "clik_sdp", {"rows": [[1.0]], "target": [2e-5]}, beta_per_s=1e5
        )
        for _ in range(round(LASTING_S / T) + 1):
            ask(controller, body)
        assert column(controller, "beta") == pytest.approx(1.0 / T, rel=1e-2)
        assert not holds(controller, SLOW)

    def test_is_not_said_at_the_target(self):
        still = tuple({**task, "target": [0.0]} for task in self.NEARLY)
        controller, body = controller_of("clik_sdp", *still)
        for _ in range(round(LASTING_S / T) + 1):
            ask(controller, body)
        assert column(controller, "beta") < 0.4
        assert controller.command.solver_status == STATUS["at_target"]
        assert not holds(controller, SLOW)

    def test_is_no_condition_of_constant_gains(self):
        controller, _ = controller_of("clik", *two())
        assert SLOW not in controller.conditions
        assert controller.conditions[: len(CONDITIONS)] == CONDITIONS
