"""`hoap3 bench gains`: certified gains along recorded motions, beside general conic solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from protocol.errors import UnknownNameError
from remote_controller.solvers.sdp_backends import PACKAGES, SOLVERS, ConicGains, installed
from remote_controller.solvers.sdp_gains import PATHS, SdpGains
from tools.bench.gains_problems import MOTIONS, Moment, Walk, stretches, walk
from tools.bench.timing import SETTLE, Contender, Times, race

OURS, COLD, TICK = "sdp", "sdp, cold", "sdp tick"
ALONE = 20
"""Ours is timed once more, alone, so many times as often: peers take milliseconds."""

BLOCKS = 20
MOTION_S = 2.0
QUICK_S, QUICK_ROBOTS = 0.2, ("ur5",)
FEWER, LEAST = {"scs": 10}, 10
"""SCS is called ten times less often, but ten times."""

COMPARED = 20
"""Problems, spread over the motion, whose answers are compared with those of the peers."""

NOTHING = 1e-6
"""Of β̃: a β up to that is none."""


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
    """How many times as long as ours each peer takes."""
    wanted = ("robot", "n", "joints", "times_sdp", "times_sdp_min")
    return [
        {"peer": row["solver"]} | {name: row[name] for name in wanted}
        for row in rows
        if row["solver"] in SOLVERS
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
    some = along.moments[:: max(1, len(along.moments) // COMPARED)]
    told = {
        OURS: _told(along, (call(*it) for it in to_and_fro)),
        COLD: _told(along, (anew(*it) for it in some)),
    }
    rows = [_row(along, name, alone[name], alone[OURS]) | told[name] for name in (OURS, COLD)]
    for name in (name for name in SOLVERS if name in installed()):
        calls = max(samples // FEWER.get(name, 1), LEAST)
        blocks = min(BLOCKS, calls)
        apart = stretches(along.moments, blocks, SETTLE + calls // blocks)
        pair = Contender(OURS, call, apart), Contender(name, SOLVERS[name], along.programs(apart))
        beside = race(pair, calls, blocks, batches=False)
        rows.append(
            _row(along, name, beside[name], beside[OURS]) | _compared(along, name, some, anew)
        )
    return rows


def _ticks(along: Walk, samples: int) -> dict[str, Any]:
    """Whole steps of `clik_sdp`: kinematics, tasks, bounds, gains, setpoints and certificate.

    The motion is gone through once at most: at a jump no tick would be like those of a loop.
    """
    calls = min(ALONE * samples, len(along.states) - BLOCKS * SETTLE)
    contender = Contender(TICK, along.law.step, [(state,) for state in along.states])
    taken = race([contender], calls, BLOCKS, batches=False)[TICK]
    return _row(along, TICK, taken, None)


def _row(along: Walk, name: str, taken: Times, ours: Times | None) -> dict[str, Any]:
    """A row; `ours` was timed in turn with it."""
    solver = along.law.solver
    return {
        "solver": name,
        "robot": along.robot,
        "n": solver.n,
        "joints": solver.joints,
        **taken.figures(),
        "times_sdp": taken.times(ours) if ours else None,
        "times_sdp_min": float(taken.single.min() / ours.single.min()) if ours else None,
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
    along: Walk, name: str, some: Sequence[Moment], ours: Callable[..., SdpGains]
) -> dict[str, Any]:
    """How far from ours β is, as the gains of a peer certify it, and how often they do not."""
    peer = along.call(along.solver(ConicGains, solver=name, polished=False))
    betas = np.array([(ours(*it).beta, peer(*it).beta) for it in some])
    failed = (betas[:, 0] > NOTHING * along.desired) & (betas[:, 1] <= NOTHING * along.desired)
    return {
        "worst_beta": float(np.abs(betas[~failed, 0] - betas[~failed, 1]).max(initial=0.0)),
        "failures": int(np.count_nonzero(failed)),
        "problems": len(some),
    }
