"""`hoap3 bench gains`: certified gains along recorded motions, beside general conic solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import UnknownNameError
from hoap3.remote_controller.solvers.sdp.sdp_backends import (
    PACKAGES,
    SOLVERS,
    ConicGains,
    installed,
)
from hoap3.remote_controller.solvers.sdp.sdp_gains import PATHS, SdpGains
from hoap3.tools.bench.problems.gains_problems import MOTIONS, Moment, Walk, stretches, walk
from hoap3.tools.bench.timing import SETTLE, Contender, Times, race

OURS, COLD, TICK, BARE = "sdp", "sdp, cold", "sdp tick", "_bare"
ALONE = 20
"""Ours is timed once more, alone, so many times as often: peers take milliseconds."""

BLOCKS = 20
MOTION_S = 2.0
QUICK_S, QUICK_ROBOTS = 0.2, ("ur5",)
FEWER, LEAST = {"scs": 10}, 10
"""SCS is called ten times less often, but ten times."""

COLD_ONES = 20
"""Ticks, spread over the motion, of which the paths of cold solves are told."""

FAILED = 0.01
"""Of β̃: gains whose β is smaller than ours by more are no answer."""


def bench_gains(
    samples: int = 200,
    robots: Sequence[str] = tuple(MOTIONS),
    seconds: float = MOTION_S,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Time `SdpGains`, warm and cold, and its peers on the same problems, in turn.

    Args:
        samples: single calls of each peer; ours is called `ALONE` times as often.
        robots: keys of `MOTIONS`.
        seconds: of each motion.
        report: is told what is timed next.

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
        report(f"{robot}, beside the others")
        rows += _rows(found, samples)
        report(f"{robot}, whole ticks")
        rows.append(_ticks(found, samples))
    return {"rows": rows, "ratios": ratios(rows)}


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


def _rows(along: Walk, samples: int) -> list[dict[str, Any]]:
    call, cold = along.call(along.solver()), along.solver()
    solve, forget = along.call(cold), cold.forget

    def anew(*it: Any) -> SdpGains:
        forget()
        return solve(*it)

    to_and_fro = [*along.moments, *along.moments[::-1]]
    longer = [Contender(OURS, call, to_and_fro), Contender(COLD, anew, to_and_fro)]
    alone = race(longer, ALONE * samples, batches=False)
    some = along.moments[:: max(1, len(along.moments) // COLD_ONES)]
    kinds = {
        OURS: _told(along, (call(*it) for it in to_and_fro)),
        COLD: _told(along, (anew(*it) for it in some)),
    }
    rows = [_row(along, name, alone[name], alone[OURS]) | kinds[name] for name in (OURS, COLD)]
    for name in (name for name in SOLVERS if name in installed()):
        calls = max(samples // FEWER.get(name, 1), LEAST)
        blocks = min(BLOCKS, calls)
        apart = stretches(along.moments, blocks, SETTLE + calls // blocks)
        peer = along.solver(ConicGains, solver=name, polished=False)
        three = (
            Contender(OURS, call, apart),
            Contender(name, along.call(peer), apart),
            Contender(name + BARE, SOLVERS[name], along.programs(apart)),
        )
        beside = race(three, calls, blocks, batches=False)
        found, away = _compared(along, name, apart, anew)
        timed = found.reshape(blocks, -1)[:, SETTLE:]
        failures = int(np.count_nonzero(~timed))
        if failures == timed.size:
            continue
        told = {"worst_beta": away, "failures": failures, "problems": timed.size}
        rows += [
            _row(along, each, beside[each], beside[OURS], timed) | told
            for each in (name, name + BARE)
        ]
    return rows


def _ticks(along: Walk, samples: int) -> dict[str, Any]:
    """Whole steps of `clik_sdp`: kinematics, tasks, bounds, gains, setpoints and certificate.

    The motion is gone through once at most: at a jump no tick would be like those of a loop.
    """
    calls = min(ALONE * samples, len(along.states) - BLOCKS * SETTLE)
    contender = Contender(TICK, along.law.step, [(state,) for state in along.states])
    taken = race([contender], calls, BLOCKS, batches=False)[TICK]
    return _row(along, TICK, taken, None)


def _row(
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
        blocks = [row.any() for row in kept]
        pairs = zip(taken.single[blocks], ours.single[blocks], kept[blocks], strict=True)
        times = float(np.median([np.median(a[k]) / np.median(b[k]) for a, b, k in pairs]))
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


def _compared(
    along: Walk, name: str, moments: Sequence[Moment], ours: Callable[..., SdpGains]
) -> tuple[NDArray[np.bool_], float]:
    """At which ticks a peer finds gains as good as ours, and how far away their β is there."""
    peer = along.call(along.solver(ConicGains, solver=name, polished=False))
    less = np.array([ours(*it).beta - peer(*it).beta for it in moments])
    found = less <= FAILED * along.desired
    return found, float(np.abs(less[found]).max(initial=0.0))
