"""`python -m benchmarks.limits`: bounds of accelerations, setpoint filters and inverse dynamics."""

from __future__ import annotations

import operator
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks import qp_peers
from benchmarks.command import main, show_missing
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.protocol.messages import State
from hoap3.remote_controller.controllers.acceleration.tsid import TsidController
from hoap3.remote_controller.solvers.qp.dense_qp import Array, Program
from hoap3.robot_emulator.filters.jerk import JerkFilter
from hoap3.robot_emulator.filters.position import PositionFilter
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.output import progress
from hoap3.tools.bench.case_runner import (
    Case,
    Report,
    reference,
    run_benchmark,
    silent,
    time_cases,
)
from hoap3.tools.bench.cycle import motion
from hoap3.tools.bench.show import show_rows
from hoap3.tools.cli.options import AsJson

SIZES = (7, 21, 32)
STATES = 256
TOLERANCE = 1e-9
PEERS = ("daqp", "quadprog", "proxqp")


def bench_limits(samples: int = 5000, report: Report = silent) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …, times_reference} of what each cycle may call.

    "bounds" and "naive bounds" are `AccelerationBounds`, "setpoint filter" is what the emulator
    does to a setpoint, "jerk filter" the same with a limit of jerk: to a wave that passes, and to
    jumps of all joints, now and then or in every period. "tsid step" is a whole cycle of the
    controller along a motion of Baxter's arm to a limit and along it, "tsid QP" its solver alone
    with its proof; those of `PEERS` that are installed solve the same programs as ready arrays,
    cold.
    """
    rng = np.random.default_rng(0)
    cases = [each for n in SIZES for each in _bounds(rng, n)]
    cases += [_filter(rng, 21), *_jerk_filters(rng), *_tsid()]
    times = time_cases([*cases, reference()], samples, report=report)
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


def _bounds(rng: np.random.Generator, n: int) -> list[Case]:
    bounds = AccelerationBounds(-np.ones(n), np.ones(n), 2.0, 20.0, 1e-3)
    least, most = np.zeros(n), np.zeros(n)
    states = [
        (rng.uniform(-1.0, 1.0, n), rng.uniform(-2.0, 2.0, n), least, most) for _ in range(STATES)
    ]
    return [
        Case(f"bounds of {n}", bounds.solve, states),
        Case(f"naive bounds of {n}", bounds.solve_naive, states),
    ]


def _filter(rng: np.random.Generator, n: int) -> Case:
    """A walk at random on HOAP-3: some steps are within all limits, some are not."""
    robot = load("hoap3")
    setpoint_filter = PositionFilter(robot, robot.period_s)
    setpoint_filter.reset(robot.initial_position)
    steps = 2.0 * rng.uniform(-1.0, 1.0, (STATES, n)) * robot.period_s
    walk = robot.initial_position + np.cumsum(steps, axis=0)
    return Case(
        f"setpoint filter of {n}",
        setpoint_filter.follow,
        [(each, tick) for tick, each in enumerate(walk)],
    )


def _jerk_filters(rng: np.random.Generator) -> list[Case]:
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
        found.append(Case(f"jerk filter, {name} of {robot.n}", filtered.follow, stream))
    return found


def _tsid() -> list[Case]:
    law, states = motion("baxter", "tsid_baxter", 2.0)
    steps = Case(f"tsid step of {law.description.n}", law.step, [(each,) for each in states])
    given = [_arguments(law, state) for state in states]
    solve = Case(f"tsid QP of {law.description.n}", law.solver.solve, given)
    effort = np.array(law.description.effort)
    programs = [program(each, effort) for each in given]
    return [
        steps,
        solve,
        *(
            Case(
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


def command(
    samples: Annotated[int, typer.Option(min=10, help="Single calls of each.")] = 5000,
    as_json: AsJson = False,
) -> None:
    """Time what keeps limits: bounds, filters, and the program of `tsid` by all solvers."""
    missing = qp_peers.missing(PEERS)

    def show(measured: dict[str, Any]) -> None:
        show_rows(measured)
        show_missing(missing)

    run_benchmark(
        progress("limits"),
        lambda meter: {"rows": bench_limits(samples, meter.part), "missing": list(missing)},
        show,
        as_json=as_json,
    )


if __name__ == "__main__":
    main(command)
