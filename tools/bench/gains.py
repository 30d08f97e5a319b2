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
PEER = "clarabel"
ALONE = 20
"""Ours is timed once more, alone, so many times as often: peers take milliseconds."""

BLOCKS = 20
MOTION_S = 2.0
QUICK_S = 0.2
COMPARED = 20
"""Problems, spread over the motion, whose answers are compared with those of the peers."""


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
    blocks = min(BLOCKS, samples)
    apart = stretches(along.moments, blocks, SETTLE + samples // blocks)
    cold = along.solver()

    call, solve, forget = along.call(along.solver()), along.call(cold), cold.forget

    def anew(*it: Any) -> SdpGains:
        forget()
        return solve(*it)

    programs = along.programs(apart)
    peers = [name for name in SOLVERS if name in installed()]
    ours = [Contender(OURS, call, apart), Contender(COLD, anew, apart)]
    others = [Contender(name, SOLVERS[name], programs) for name in peers]
    beside = race([*ours, *others], samples, BLOCKS, batches=False)
    to_and_fro = [*along.moments, *along.moments[::-1]]
    longer = [Contender(OURS, call, to_and_fro), Contender(COLD, anew, to_and_fro)]
    alone = race(longer, ALONE * samples, batches=False)
    some = along.moments[:: max(1, len(along.moments) // COMPARED)]
    told = {
        OURS: _told(along, (call(*it) for it in to_and_fro)),
        COLD: _told(along, (anew(*it) for it in some)),
    }
    rows = []
    for name, taken in {**beside, **alone}.items():
        times = beside[name].times(beside[OURS])
        least = float(beside[name].single.min() / beside[OURS].single.min())
        away = _away(along, name, some, anew) if name in SOLVERS else None
        rows.append(
            _row(along, name, taken, times, least) | told.get(name, {}) | {"worst_beta": away}
        )
    return rows


def _ticks(along: Walk, samples: int) -> dict[str, Any]:
    """Whole steps of `clik_sdp`: kinematics, tasks, bounds, gains, setpoints and certificate.

    The motion is gone through once at most: at a jump no tick would be like those of a loop.
    """
    calls = min(ALONE * samples, len(along.states) - BLOCKS * SETTLE)
    contender = Contender(TICK, along.law.step, [(state,) for state in along.states])
    taken = race([contender], calls, BLOCKS, batches=False)[TICK]
    return _row(along, TICK, taken, None, None)


def _row(
    along: Walk, name: str, taken: Times, times: float | None, least: float | None
) -> dict[str, Any]:
    solver = along.law.solver
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


def _away(along: Walk, name: str, some: Sequence[Moment], ours: Callable[..., SdpGains]) -> float:
    """How far from ours β is of what a peer gives, as its gains certify it."""
    peer = along.call(along.solver(ConicGains, solver=name, polished=False))
    return max(abs(peer(*it).beta - ours(*it).beta) for it in some)
