"""`python -m benchmarks.gains`: certified gains along recorded motions, and conic solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from benchmarks.command import Calls, Quick, main, show_missing, show_ratio
from benchmarks.conic_gains import SOLVERS, ConicGains
from benchmarks.gains_problems import MOTIONS, Moment, Walk, walk
from benchmarks.sdp_backends import PACKAGES, installed
from hoap3.protocol.errors import UnknownNameError
from hoap3.remote_controller.solvers.sdp.sdp_gains import PATHS, SdpGains
from hoap3.tools.analysis.output import progress
from hoap3.tools.bench.case_runner import (
    SETTLE,
    Case,
    Times,
    median_ratio,
    run_benchmark,
    time_cases,
)
from hoap3.tools.bench.show import FEWER, SINGLE, number, numbers, show_table, words
from hoap3.tools.cli.options import AsJson

OURS, COLD, TICK = "sdp", "sdp, cold", "sdp tick"
ALONE = 20
"""Calls of each for one of `samples`, which counts those of solvers that take milliseconds."""

BLOCKS = 20
MOTION_S = 2.0
QUICK_S, QUICK_ROBOTS = 0.2, ("ur5",)
COLD_ONES = 20
"""Number of ticks, spread over the motion, at which the path of a cold solve is reported."""

BARE = "_bare"
CALLED_LESS, LEAST = {"scs": 10}, 10
"""SCS is called ten times less often, but ten times."""

FAILED = 0.01
"""Of β̃: gains whose β is smaller than ours by more are no answer."""


def compare_gains(
    samples: int = 200,
    robots: Sequence[str] = tuple(MOTIONS),
    seconds: float = MOTION_S,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Time `SdpGains`, warm and cold, conic solvers on the same problems, and whole ticks.

    Args:
        samples: single calls of each peer; ours is called `ALONE` times as often.
        robots: keys of `MOTIONS`.
        seconds: of each motion.
        report: takes what is timed next.

    Returns:
        `rows`, and `ratios`, {robot, n, joints, peer, times_sdp, times_sdp_min} of each peer.

    Raises:
        UnknownNameError: there is no motion of a robot.
    """
    for robot in robots:
        if robot not in MOTIONS:
            raise UnknownNameError("robot", robot, MOTIONS)
    rows = []
    for robot in robots:
        report(f"{robot}, its motion")
        found = walk(robot, seconds)
        report(f"{robot}, its gains")
        rows += _own_rows(found, samples)
        report(f"{robot}, conic solvers")
        rows += _peer_rows(found, samples)
        report(f"{robot}, whole ticks")
        rows.append(_ticks_row(found, samples))
    return {"rows": rows, "ratios": ratios(rows)}


def _cold_call(along: Walk) -> Callable[..., SdpGains]:
    """A function of what a `Moment` has, whose solver forgets its last answer before each."""
    cold = along.solver()
    solve, forget = along.call(cold), cold.forget

    def call(*it: Any) -> SdpGains:
        forget()
        return solve(*it)

    return call


def _own_rows(along: Walk, samples: int) -> list[dict[str, Any]]:
    """Rows of our solver, warm and cold."""
    call, cold = along.call(along.solver()), _cold_call(along)
    to_and_fro = [*along.moments, *along.moments[::-1]]
    longer = [Case(OURS, call, to_and_fro), Case(COLD, cold, to_and_fro)]
    alone = time_cases(longer, ALONE * samples, batches=False)
    some = along.moments[:: max(1, len(along.moments) // COLD_ONES)]
    kinds = {
        OURS: _told(along, (call(*it) for it in to_and_fro)),
        COLD: _told(along, (cold(*it) for it in some)),
    }
    return [
        _gains_row(along, name, alone[name], alone[OURS]) | kinds[name] for name in (OURS, COLD)
    ]


def _ticks_row(along: Walk, samples: int) -> dict[str, Any]:
    """Whole steps of `clik_sdp`: kinematics, tasks, bounds, gains, setpoints and certificate.

    The motion is gone through once at most: at a jump no tick would be like those of a loop.
    """
    calls = min(ALONE * samples, len(along.states) - BLOCKS * SETTLE)
    case = Case(TICK, along.law.step, [(state,) for state in along.states])
    taken = time_cases([case], calls, BLOCKS, batches=False)[TICK]
    return _gains_row(along, TICK, taken, None)


def _gains_row(
    along: Walk,
    name: str,
    taken: Times,
    ours: Times | None,
    timed: NDArray[np.bool_] | None = None,
) -> dict[str, Any]:
    """A row; `ours` was timed in turn with it. Of both only the calls `timed` count, or all."""
    solver, times, least = along.law.solver, None, None
    if ours is not None:
        kept = np.ones(taken.single.shape, bool) if timed is None else timed
        columns = [
            [
                float(np.median(row[some]))
                for row, some in zip(each, kept, strict=True)
                if some.any()
            ]
            for each in (taken.single, ours.single)
        ]
        times = median_ratio(*columns)
        least = float(taken.single[kept].min() / ours.single[kept].min())
        taken = Times(taken.single[kept], taken.batch)
    return {
        "solver": name,
        "robot": along.robot,
        "n": solver.n,
        "joints": solver.joints,
        **taken.figures(),
        "times_sdp": times,
        "times_sdp_min": least,
        "paths": None,
        "newton_mean": None,
        "worst_gap": None,
        "worst_beta": None,
        "failures": None,
        "problems": None,
    }


def _told(along: Walk, solved: Iterable[SdpGains]) -> dict[str, Any]:
    """What answers are like, each read before the next is found."""
    found = [(each.path, each.newton, each.gap) for each in solved]
    path, newton, gap = (np.array(each) for each in zip(*found, strict=True))
    return {
        "paths": {name: float(np.mean(path == k)) for k, name in enumerate(PATHS)},
        "newton_mean": float(newton.mean()),
        "worst_gap": float(gap.max()) / along.desired**2,
    }


def missing() -> dict[str, str]:
    """Peers that are not installed, and their packages."""
    there = installed()
    return {name: PACKAGES[name] for name in SOLVERS if name not in there}


def ratios(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """How many times as long as ours each peer takes, and its bare solver alone."""
    wanted = ("robot", "n", "joints", "times_sdp", "times_sdp_min")
    return [
        {"peer": row["solver"]} | {name: row[name] for name in wanted}
        for row in rows
        if row["solver"].removesuffix(BARE) in SOLVERS
    ]


def _peer_rows(along: Walk, samples: int) -> list[dict[str, Any]]:
    call, cold = along.call(along.solver()), _cold_call(along)
    rows = []
    for name in (name for name in SOLVERS if name in installed()):
        calls = max(samples // CALLED_LESS.get(name, 1), LEAST)
        blocks = min(BLOCKS, calls)
        apart = stretches(along.moments, blocks, SETTLE + calls // blocks)
        peer = along.solver(ConicGains, solver=name, polished=False)
        three = (
            Case(OURS, call, apart),
            Case(name, along.call(peer), apart),
            Case(name + BARE, SOLVERS[name], programs(along, apart)),
        )
        beside = time_cases(three, calls, blocks, batches=False)
        found, away = _compared(along, name, apart, cold)
        timed = found.reshape(blocks, -1)[:, SETTLE:]
        failures = int(np.count_nonzero(~timed))
        if failures == timed.size:
            continue
        told = {"worst_beta": away, "failures": failures, "problems": timed.size}
        rows += [
            _gains_row(along, each, beside[each], beside[OURS], timed) | told
            for each in (name, name + BARE)
        ]
    return rows


def _compared(
    along: Walk, name: str, moments: Sequence[Moment], ours: Callable[..., SdpGains]
) -> tuple[NDArray[np.bool_], float]:
    """At which ticks a peer finds gains as good as ours, and how far away their β is there."""
    peer = along.call(along.solver(ConicGains, solver=name, polished=False))
    less = np.array([ours(*it).beta - peer(*it).beta for it in moments])
    found = less <= FAILED * along.desired
    return found, float(np.abs(less[found]).max(initial=0.0))


def programs(along: Walk, moments: Sequence[Moment]) -> list[tuple[Any, ...]]:
    """The same problems as arguments of `SOLVERS`."""
    conic: Any = along.solver(ConicGains, solver=next(iter(SOLVERS)))
    found = []
    for it in moments:
        conic.lower[:], conic.upper[:] = it.lower, it.upper
        found.append(conic.program(it.jacobian, it.errors, along.dt, along.desired, along.delta))
    return found


def stretches(moments: Sequence[Moment], blocks: int, calls: int) -> list[Moment]:
    """So many stretches of so many moments in a row, spread over a walk, one after the other."""
    there = [*moments, *moments[::-1]]
    first = np.linspace(0, max(len(moments) - calls, 0), blocks).astype(int)
    return [there[(begin + k) % len(there)] for begin in first for k in range(calls)]


def show(measured: dict[str, Any]) -> None:
    """Print a row a solver, and the ratios below."""

    def cells(row: dict[str, Any]) -> dict[str, str]:
        failures = "" if row["failures"] is None else f"{row['failures']} of {row['problems']}"
        paths = (row["paths"] or {}).items()
        return {
            **words(row, "solver", "robot", "n", "joints", "samples"),
            **numbers(row, ".1f", *FEWER, "times_sdp"),
            "paths": ", ".join(f"{name} {share:.2%}" for name, share in paths if share),
            "newton": number(row["newton_mean"], ".1f"),
            **numbers(row, ".0e", "worst_gap", "worst_beta"),
            "failures": failures,
        }

    show_table(f"{SINGLE}certified gains", measured["rows"], cells, measured["machine"])
    for row in measured["ratios"]:
        what = f"{row['robot']}, {row['n']} rows, {row['joints']} joints: {row['peer']}"
        show_ratio(what, row["times_sdp"], row["times_sdp_min"])
    show_missing(missing())


def command(
    samples: Calls = 200,
    robot: Annotated[
        list[str] | None,
        typer.Option(help="Whose motion: ur5, hoap3 or humanoid32; by default all, one by one."),
    ] = None,
    quick: Quick = False,
    as_json: AsJson = False,
) -> None:
    """Time certified gains along motions of 6, 21 and 32 joints, and conic solvers."""
    calls, seconds = (10, QUICK_S) if quick else (samples, MOTION_S)
    robots = robot or (QUICK_ROBOTS if quick else tuple(MOTIONS))
    run_benchmark(
        progress("gains"),
        lambda meter: {
            **compare_gains(calls, robots, seconds, report=meter.step),
            "missing": list(missing()),
        },
        show,
        as_json=as_json,
    )


if __name__ == "__main__":
    main(command)
