"""What every controller must do, whoever wrote it."""

from __future__ import annotations

import gc
import sys
import tracemalloc
from collections.abc import Sequence
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numba.core import event

from hoap3.protocol.messages import STAMP_FIELDS, Setpoint
from hoap3.remote_controller.controllers.acceleration.weighted import WeighedController
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.service import rehearse
from hoap3.tools.testing.body import moved, state_of
from hoap3.tools.testing.controller_case import LENGTH, ControllerCase, controller_case
from hoap3.tools.testing.suite import Suite, Value, over

ULP = np.finfo(float).eps
KEPT = 1024
"""Bytes by which 200 steps may grow: a few numbers of another size. A float kept per step is 4,800,
in every round; what libraries keep for a while goes up and down."""


def every(suite: ControllerProperties) -> list[Value]:
    """All cases; further configs of one controller are slow where the robot may fall."""
    known = suite.known()
    quick = [*first_of_each_law(known), *(case for case in known if not case.stands_free)]
    return [Value((case,), case.label, "usual" if case in quick else "slow") for case in known]


def first_of_each_law(known: Sequence[ControllerCase]) -> list[ControllerCase]:
    """A case of each controller."""
    return list({case.config.controller: case for case in reversed(known)}.values())


def of_each_law(suite: ControllerProperties) -> list[Value]:
    """A case of each controller; further configs of the same one are slow."""
    known = suite.known()
    first = first_of_each_law(known)
    return [Value((case,), case.label, "usual" if case in first else "slow") for case in known]


def positions(suite: ControllerProperties) -> list[Value]:
    """Those whose setpoints are positions."""
    return [Value((case,), case.label) for case in suite.known() if case.gives_positions]


def pairs(suite: ControllerProperties) -> list[Value]:
    """Two of one robot, of which the second takes over; all but a ring of them are long."""
    found = []
    known = [case for case in suite.known() if case.gives_positions]
    for robot in dict.fromkeys(case.robot.name for case in known):
        cases = [case for case in known if case.robot.name == robot]
        ring = list(zip(cases, [*cases[1:], *cases[:1]], strict=True))
        for pair in product(cases, cases):
            label = "-".join(case.label for case in pair)
            found.append(Value(pair, label, "usual" if pair in ring else "long"))
    return found


def postures(suite: ControllerProperties) -> list[Value]:
    """Every posture of every case's robot to start from; all but the first of a law's are slow.

    One that may fall starts in its own: it need not stand in others.
    """
    return [
        Value((case, posture), f"{case.label}-{posture}", "slow" if place else each.weight)
        for each in of_each_law(suite)
        for case in each.given
        for place, posture in enumerate(case.robot.postures)
        if place == 0 or not case.robot.state_arrays.get("base")
    ]


class ControllerProperties(Suite):
    """What every controller must do.

    Limits, jumps and the derivative of V are looked at only where setpoints are positions.

    Attributes:
        cases: config files, `package.module:Class`, or registered names. A bare class is built with
            its default parameters. A hand-over is tried between all that are named, so add `qp12`
            to see yours taking over from it.
        robot: what they move, a name or a path; None: what each one's config names.
        resting: those of the cases that stand still until somebody steers them.
    """

    cases: ClassVar[Sequence[Any]] = ()
    resting: ClassVar[Sequence[str]] = ()
    robot: ClassVar[str | None] = None

    def known(self) -> list[ControllerCase]:
        """The cases, each with its robot and its motions."""
        return [controller_case(str(case), self.robot) for case in self.cases]

    @over("case", positions)
    def test_it_obeys_the_limits_of_the_robot_at_every_tick(self, case: ControllerCase) -> None:
        description = case.robot
        answers, applied = case.two_seconds(case.emulator.posture)
        setpoints = answers["values"]
        count = len(setpoints)
        assert count >= 2000
        assert (setpoints >= description.lower_hard).all()
        assert (setpoints <= description.upper_hard).all()
        step = np.abs(setpoints - applied[:count])
        assert (step <= description.velocity * description.period_s + ULP * np.abs(setpoints)).all()
        assert (applied >= description.lower).all()
        assert (applied <= description.upper).all()
        # what it certifies, the robot took over bit by bit: there was nothing to hold back
        certified = answers["solver_status"][:-1] == STATUS["certified"]
        np.testing.assert_array_equal(applied[1:count][certified], setpoints[:-1][certified])

    @over("case", of_each_law)
    def test_two_runs_give_the_same_bytes(self, case: ControllerCase) -> None:
        first, second = case.run(0.5), case.run(0.5)
        assert [record.payload for record in first.records] == [
            record.payload for record in second.records
        ]

    @over("case", of_each_law)
    def test_its_answers_follow_from_reset_and_states_alone(self, case: ControllerCase) -> None:
        payloads, setpoints = case.motion
        first, last = 300, setpoints[299]
        states = [state_of(case.robot, payload) for payload in payloads[first : first + 200]]

        fresh = case.make()
        fresh.reset(states[0], last)
        expected = [without_stamps(fresh.step(state)) for state in states]

        used = case.make()
        clock = iter(range(10**9))
        used.now = lambda: next(clock)  # and time is not an input
        used.reset(state_of(case.robot, payloads[900]), setpoints[5])
        for payload in payloads[900:1100]:
            used.step(state_of(case.robot, payload))
        used.reset(states[0], last)
        assert [without_stamps(used.step(state)) for state in states] == expected

    @over("case", positions)
    @over("tick", [0, 250], long=[1, LENGTH - 1])
    @over("last", ["none", "the last", "zeros", "far"])
    def test_it_starts_anywhere_without_a_jump(
        self, case: ControllerCase, tick: int, last: str
    ) -> None:
        payloads, setpoints = case.motion
        state = state_of(case.robot, payloads[tick])
        controller = case.make()
        controller.reset(
            state,
            {
                "none": None,
                "the last": setpoints[max(tick - 1, 0)],
                "zeros": np.zeros(case.robot.n),
                "far": case.robot.upper.copy(),
            }[last],
        )
        jump = np.abs(controller.step(state).values - state.reference)
        allowed = case.robot.velocity
        u_max = getattr(controller.parameters, "u_max_rad_s", None)
        if u_max is not None:
            allowed = np.minimum(allowed, u_max)
        assert (jump <= allowed * case.robot.period_s + ULP * np.abs(state.reference)).all()

    @over("case,successor", pairs)
    @over("start", ["cold", "shadowing"])
    @over("tick", [400], long=[50, 1000])
    def test_another_takes_over_without_a_jump(
        self, case: ControllerCase, successor: ControllerCase, start: str, tick: int
    ) -> None:
        """Joints faster than what the robot can stop in a period are slowed down by its filter."""
        payloads, setpoints = case.motion
        controller = successor.make()
        if (
            start == "shadowing"
        ):  # it followed in silence, as a second process does before it takes over
            shadowed = [state_of(case.robot, payload) for payload in payloads[tick - 50 : tick]]
            controller.reset(shadowed[0], None)
            for state in shadowed:
                controller.step(state)
        state = state_of(case.robot, payloads[tick])
        controller.reset(state, setpoints[tick - 1])
        dt = case.robot.period_s
        after = (controller.step(state).values - setpoints[tick - 1]) / dt
        before = (setpoints[tick - 1] - setpoints[tick - 2]) / dt
        at_once = case.robot.setpoint_acceleration_max * dt
        slow = np.abs(before) <= at_once
        assert (np.abs(after - before)[slow] <= at_once[slow]).all()

    @over("case,posture", postures)
    def test_its_certificates_hold(self, case: ControllerCase, posture: str) -> None:
        setpoints, _ = case.two_seconds(posture)
        status = setpoints["solver_status"]
        assert set(status) <= set(STATUS.values())
        for field in setpoints.dtype.names:
            assert np.isfinite(setpoints[field]).all(), field
        proven = status == STATUS["certified"]
        v = setpoints["v"]
        allowed = 4 * ULP * v[:-1] + second_order(case, setpoints)
        falls = (proven & (setpoints["v_rate_required"] <= 0.0))[:-1]
        assert (np.diff(v)[falls] <= allowed[falls]).all()
        certified = setpoints[proven]
        required, predicted = certified["v_rate_required"], certified["v_rate_predicted"]
        assert (v >= 0.0).all()
        assert (predicted <= required + 1e-9 * np.abs(required)).all()
        assert (certified["kkt_residual"] >= 0.0).all()
        assert (certified["kkt_residual"] <= 1e-9).all()
        assert (certified["rho"] >= 0.0).all()
        assert (certified["rho"] <= 1.0).all()
        resting = setpoints[status == STATUS["at_target"]]
        assert (resting["v_rate_required"] == 0.0).all()

    @over("case", positions)
    @over("tick", [0, 10, 100, 300, 700])
    def test_its_prediction_of_v_is_the_derivative_along_the_motion(
        self, case: ControllerCase, tick: int
    ) -> None:
        payloads, _ = case.motion
        state = state_of(case.robot, payloads[tick])
        controller = case.make()
        controller.reset(state, None)
        command = controller.step(state)
        if command.solver_status != STATUS["certified"]:
            return  # it promises nothing here
        v, predicted = command.v, command.v_rate_predicted
        move, start = command.values - state.reference, state.reference.copy()
        errors = []
        for share in (1.0, 0.5, 0.25):
            state.reference[:] = start + share * move
            state.q[:] = state.reference
            controller.reset(state, None)
            slope = (controller.step(state).v - v) / (share * case.robot.period_s)
            errors.append(abs(slope - predicted))
        rounding = 100 * ULP * v / case.robot.period_s
        assert errors[0] <= 0.02 * abs(predicted) + rounding
        assert errors[1] <= 0.6 * errors[0] + rounding  # of first order in the period
        assert errors[2] <= 0.6 * errors[1] + rounding

    @over("case", of_each_law)
    def test_it_keeps_nothing_of_what_it_allocates(self, case: ControllerCase) -> None:
        payloads, _ = case.motion
        states = [state_of(case.robot, payload) for payload in payloads[:100]]
        controller = case.make()
        rehearse(controller, case.robot)
        controller.reset(states[0], None)
        gc.collect()
        growths: list[int] = []
        tracemalloc.start()
        try:
            for state in states:  # fills whatever has a bound
                controller.step(state)
            while len(growths) < 3 and min(growths, default=KEPT + 1) > KEPT:
                gc.collect()
                before = tracemalloc.get_traced_memory()[0]
                for _ in range(2):
                    for state in states:
                        controller.step(state)
                gc.collect()
                growths.append(tracemalloc.get_traced_memory()[0] - before)
        finally:
            tracemalloc.stop()
        assert min(growths) <= KEPT

    @over("case", of_each_law)
    def test_its_rehearsal_leaves_nothing_to_compile_or_import(self, case: ControllerCase) -> None:
        payloads, _ = case.motion
        controller = case.make()
        rehearse(controller, case.robot)
        states = [state_of(case.robot, payload) for payload in payloads[:100]]
        modules = set(sys.modules)
        with event.install_recorder("numba:compile") as compiled:
            controller.reset(states[0], None)
            for state in states:
                controller.step(state)
        assert not compiled.buffer
        assert set(sys.modules) == modules

    @over("case", every)
    def test_it_writes_into_its_own_command_only(self, case: ControllerCase) -> None:
        payloads, setpoints = case.motion
        controller, other = case.make(), case.make()
        alone = case.make()
        last = setpoints[99].copy()
        for each in (controller, alone):
            each.reset(state_of(case.robot, payloads[100]), last)
        other.reset(state_of(case.robot, payloads[700]), None)
        for tick in range(100, 200):
            state = state_of(case.robot, payloads[tick])
            command = controller.step(state)
            assert command is controller.command
            assert state.dump() == payloads[tick]
            written = command.dump()
            other.step(state_of(case.robot, payloads[tick + 600]))
            assert command.dump() == written
            assert alone.step(state).dump() == written
        np.testing.assert_array_equal(last, setpoints[99])

    @over("case", every)
    def test_the_order_of_joints_on_the_wire_does_not_matter(self, case: ControllerCase) -> None:
        straight = case.robot
        order = np.random.default_rng(5).permutation(straight.n)
        shuffled = straight.model_copy(
            update={
                "joints": tuple(straight.joints[i] for i in order),
                "postures": {
                    name: tuple(values[i] for i in order)
                    for name, values in straight.postures.items()
                },
            }
        )
        body, controller = case.body(shuffled), case.make(shuffled)
        controller.reset(body.state, None)
        setpoints = np.array([values for _, values in moved(controller, body, 300)])
        expected = case.motion[1][:300]
        atol = max(1e-9, exactness(controller) * np.abs(expected).max())
        np.testing.assert_allclose(setpoints, expected[:, order], rtol=0, atol=atol)
        went = np.abs(expected[-1] - straight.initial_position).max()
        assert (went > 1e-3) != (case.name in self.resting)  # else nothing was tried

    @over("case", every)
    def test_it_gives_nothing_to_follow_for_a_state_that_is_not_finite(
        self, case: ControllerCase
    ) -> None:
        payloads, _ = case.motion
        state = state_of(case.robot, payloads[100])
        controller = case.make()
        controller.reset(state, None)
        for array in (state.q, state.dq, state.tau, state.reference):
            array[0] = np.nan
        command = controller.step(state)
        assert command.solver_status != STATUS["certified"]
        assert not np.isfinite(command.values).all()  # so the robot refuses it


def exactness(controller: Controller) -> float:
    """How exactly a QP of a robot on its soles is solved: nεκ of its matrix, else 0.

    Backward stable elimination does no better (Higham, Accuracy and Stability, Theorem 10.4), and
    weights there lie 1e7 apart.
    """
    if not isinstance(controller, WeighedController):
        return 0.0
    if controller.tasks.jacobian.shape == controller.problem.jacobian.shape:  # the base stands
        return 0.0
    weights = np.repeat(controller.importance.value, controller.tasks.sizes)
    J = np.sqrt(weights)[:, None] * controller.problem.jacobian
    s = np.linalg.svd(J, compute_uv=False)
    return float(J.shape[1] * ULP * (s[0] / s[J.shape[1] - 1]) ** 2)


def without_stamps(command: Setpoint) -> bytes:
    """What a command says, but not when."""
    for name in STAMP_FIELDS:
        setattr(command, name, 0)
    return command.dump()


def second_order(case: ControllerCase, setpoints: np.ndarray[Any, Any]) -> float:
    """By how much V may rise in a tick where its target moves: 0 where it names no `drift`.

    |∂V/∂t| = |e·w| of a target's velocity w, so drift/|e| is at most its speed. Both w and what
    the robot makes of it move e by w·T, of which V = |e|²/2 predicts the first order only.
    """
    names = case.make().extra_names
    if "drift" not in names:
        return 0.0
    drift = np.abs(setpoints["extra"][:, names.index("drift")])
    moves = drift > 0.0
    speed = np.max(drift[moves] / np.sqrt(2.0 * setpoints["v"][moves]), initial=0.0)
    return float((2.0 * speed * case.robot.period_s) ** 2 / 2.0)
