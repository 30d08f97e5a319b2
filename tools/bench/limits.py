"""`hoap3 bench limits`: bounds of accelerations, the setpoint filter, and inverse dynamics."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from hoap3.protocol.messages import State
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.torque_bounds import torque_acceleration_bounds
from hoap3.protocol.robot.viability_bounds import AccelerationBounds
from hoap3.remote_controller.controllers.acceleration.tsid import TsidController
from hoap3.remote_controller.solvers.qp.qp_backends import Array, Program
from hoap3.robot_emulator.filters.jerk import JerkFilter
from hoap3.robot_emulator.filters.position import PositionFilter
from hoap3.robot_emulator.robots import load
from hoap3.tools.bench import qp_peers
from hoap3.tools.bench.problems.steps import motion
from hoap3.tools.bench.reference import reference
from hoap3.tools.bench.timing import Contender, Report, race, silent

SIZES = (7, 21, 32)
STATES = 256
PEERS, TOLERANCE = ("daqp", "quadprog", "proxqp"), 1e-9
ARM = "baxter_left_arm"
PAPER_SAMPLING_S = 300.0
"""Algorithm 4 with a million samples takes 5 minutes in the paper's own implementation."""


def bench_limits(samples: int = 5000, report: Report = silent) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …, times_reference} of what each cycle may call.

    "bounds" and "naive bounds" are `AccelerationBounds`, "setpoint filter" is what the emulator
    does to a setpoint, "jerk filter" the same with a limit of jerk: to a wave that passes, and to
    jumps of all joints, now and then or in every period. "tsid step" is a whole cycle of the
    controller along a motion of Baxter's arm to a limit and along it, "tsid QP" its solver alone
    with its proof; the others solve the same
    programs as ready arrays, cold.
    """
    rng = np.random.default_rng(0)
    contenders = [each for n in SIZES for each in _bounds(rng, n)]
    contenders += [_filter(rng, 21), *_jerk_filters(rng), *_tsid()]
    times = race([*contenders, reference()], samples, report=report)
    return [
        {
            "solver": name.rpartition(" of ")[0] or name,
            "n": int(name.rpartition(" of ")[2]) if " of " in name else 21,
            **taken.figures(),
            "times_reference": taken.times(times["reference"]),
            "paper": None,
        }
        for name, taken in times.items()
    ]


def bench_sampling(
    samples: int = 1_000_000, report: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Algorithm 4 on Baxter's arm: seconds, and samples per second."""
    robot = build_model(load(ARM))
    torque_acceleration_bounds(robot, 10)  # compiled, whatever was in the cache
    begin = time.perf_counter()
    found = torque_acceleration_bounds(robot, samples, report=report)
    took = time.perf_counter() - begin
    return {
        "robot": ARM,
        "samples": found.samples,
        "seconds": took,
        "samples_per_s": found.samples / took,
        "paper_seconds": PAPER_SAMPLING_S if samples == 1_000_000 else None,
    }


def missing() -> dict[str, str]:
    """Peers that are not installed, and their packages."""
    return qp_peers.missing(PEERS)


def _bounds(rng: np.random.Generator, n: int) -> list[Contender]:
    bounds = AccelerationBounds(-np.ones(n), np.ones(n), 2.0, 20.0, 1e-3)
    least, most = np.zeros(n), np.zeros(n)
    states = [
        (rng.uniform(-1.0, 1.0, n), rng.uniform(-2.0, 2.0, n), least, most) for _ in range(STATES)
    ]
    return [
        Contender(f"bounds of {n}", bounds.solve, states),
        Contender(f"naive bounds of {n}", bounds.solve_naive, states),
    ]


def _filter(rng: np.random.Generator, n: int) -> Contender:
    """A walk at random on HOAP-3: some steps are within all limits, some are not."""
    robot = load("hoap3")
    setpoint_filter = PositionFilter(robot, robot.period_s)
    setpoint_filter.reset(robot.initial_position)
    steps = 2.0 * rng.uniform(-1.0, 1.0, (STATES, n)) * robot.period_s
    walk = robot.initial_position + np.cumsum(steps, axis=0)
    return Contender(
        f"setpoint filter of {n}",
        setpoint_filter.follow,
        [(each, tick) for tick, each in enumerate(walk)],
    )


def _jerk_filters(rng: np.random.Generator) -> list[Contender]:
    """HOAP-3 with 1e4 rad/s³: along a wave within all limits, and to places that jump.

    Those are anywhere and new every 0.3 s, or new in every period: anywhere, and about the start.
    """
    plain = load("hoap3")
    change = {"setpoint_jerk_max": 1e4}
    joints = tuple(joint.model_copy(update=change) for joint in plain.joints)
    robot = plain.model_copy(update={"joints": joints})
    t = 2.0 * np.pi * np.linspace(0.0, 1.0, 1200)[:, None]
    start = robot.initial_position
    inwards = np.where(start > 0.5 * (robot.lower + robot.upper), -1.0, 1.0)
    wave = start + 0.05 * inwards * (1.0 - np.cos(t - np.sin(t)))
    jumps = np.repeat(rng.uniform(robot.lower, robot.upper, (4, robot.n)), 300, axis=0)
    paths = {
        "a wave": wave,
        "jumps": jumps,
        "new jumps": rng.uniform(robot.lower, robot.upper, (1200, robot.n)),
        "noise": start + rng.normal(0.0, 1e-3, (1200, robot.n)),
    }
    found = []
    for name, path in paths.items():
        filtered = JerkFilter(robot, robot.period_s)
        filtered.reset(start)
        stream = [(each, tick) for tick, each in enumerate(path)]
        found.append(Contender(f"jerk filter, {name} of {robot.n}", filtered.follow, stream))
    return found


def _tsid() -> list[Contender]:
    law, states = motion("baxter", "tsid_baxter", 2.0)
    steps = Contender(f"tsid step of {law.description.n}", law.step, [(each,) for each in states])
    given = [_arguments(law, state) for state in states]
    solve = Contender(f"tsid QP of {law.description.n}", law.solver.solve, given)
    effort = np.array(law.description.effort)
    programs = [program(each, effort) for each in given]
    return [
        steps,
        solve,
        *(
            Contender(
                f"{name} of {law.description.n}",
                operator.call,
                [(make(each), TOLERANCE) for each in programs],
            )
            for name, make in qp_peers.installed(PEERS).items()
        ),
    ]


def program(given: tuple[Any, ...], effort: Array) -> Program:
    """What `Tsid.solve` is given, as a QP with the torques eliminated."""
    jacobian, wanted, weight, posture, mass, bias, lower, upper = given
    H = jacobian.T @ jacobian + weight * np.eye(len(posture))
    f = -(jacobian.T @ wanted + weight * posture)
    least, most = np.concatenate([lower, -effort - bias]), np.concatenate([upper, effort - bias])
    return Program(H, f, mass, least, most, np.zeros(least.size, np.int32))


def _arguments(law: TsidController, state: State) -> tuple[Any, ...]:
    """What the controller gives its solver at a State, copied."""
    kept: list[tuple[Any, ...]] = []
    solver = law.solver

    class Notes:
        """Stands for the solver, and keeps what it is given."""

        def __getattr__(self, name: str) -> Any:
            return getattr(solver, name)

        def solve(self, *given: Any) -> int:
            arrays = (np.array(one) if isinstance(one, np.ndarray) else one for one in given)
            kept.append(tuple(arrays))
            return solver.solve(*given)

    law.solver = Notes()  # type: ignore[assignment]
    law.step(state)
    law.solver = solver
    return kept[0]
