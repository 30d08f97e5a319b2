"""Fig. 4: one joint to its upper limit by (31) and (32), within naive and within viable bounds.

The joint integrates exactly what it is told, (1), by the kernel of the shipped controller
`joint_acceleration`, with the paper's gains; nothing stands between the two. Its target is 0.1 rad
above the limit, as section V-A prints. Where it starts is not printed: ours is at rest in the
middle of its range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.controllers.acceleration.joint_acceleration_kernels import (
    accelerate_to,
)
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.bounds.joint import FIG_4, Joint
from hoap3.tools.reproduce.papers.bounds.reference import motion
from hoap3.tools.reproduce.papers.bounds.viable_set import peak
from hoap3.tools.reproduce.rows import Row, bounded, near

KP = 1000.0  # 1/s²
TARGET = FIG_4.end + 0.1  # rad, section V-A
SECONDS = 6.0
SHOWN_S = 2.0
LAST_S = 0.5
RESTING = 1e-6  # rad/s², rms
ROUNDING = 1e-12  # rad and rad/s

NAIVE = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0)
PROPOSED = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
TOO_LARGE = 20.0
"""T_b/δt with which (11) is violated: 2 rad/s < 20·0.01·12."""


@dataclass(frozen=True, eq=False)
class Run:
    """A motion, one row a tick.

    Attributes:
        joint: that moves.
        q, dq, a: position, velocity, and the acceleration that is then held for δt.
    """

    joint: Joint
    q: Array
    dq: Array
    a: Array

    @property
    def time_s(self) -> Array:
        """Since the start."""
        return np.arange(len(self.q), dtype=np.float64) * self.joint.period_s

    @property
    def excess(self) -> float:
        """How far the joint goes beyond q_max, also between ticks [rad]; 0 if it does not."""
        farthest = peak(self.q, self.dq, self.a, self.joint.period_s).max()
        return max(0.0, float(farthest) - self.joint.end)

    @property
    def too_fast(self) -> float:
        """How far |dq| exceeds the limit [rad/s]; 0 if it does not."""
        return max(0.0, float(np.abs(self.dq).max()) - self.joint.speed)

    @property
    def speed_at_limit(self) -> float:
        """Where it first crosses q_max; NaN where it does not [rad/s]."""
        beyond = np.flatnonzero(self.q > self.joint.end + ROUNDING)
        if not beyond.size:
            return math.nan
        k = int(beyond[0]) - 1
        return math.sqrt(self.dq[k] ** 2 + 2.0 * self.a[k] * (self.joint.end - self.q[k]))

    def rms(self, end_s: float) -> float:
        """Root mean square of the acceleration in the half second before `end_s` [rad/s²]."""
        ticks = slice(
            round((end_s - LAST_S) / self.joint.period_s), round(end_s / self.joint.period_s)
        )
        return float(np.sqrt((self.a[ticks] ** 2).mean()))

    @property
    def arrivals(self) -> int:
        """How often it comes to q_max anew."""
        there = self.joint.end - self.q < 1e-6
        return int((there[1:] & ~there[:-1]).sum())


@dataclass(frozen=True)
class Runs:
    """All of them, by T_b/δt.

    Attributes:
        naive: within (2).
        proposed: within Algorithm 3.
        refused: what `TOO_LARGE` is answered with.
        shrunk: with it, and the acceleration lowered to what (11) asks for.
    """

    naive: Mapping[float, Run]
    proposed: Mapping[float, Run]
    refused: str
    shrunk: Run


def move(periods: float, *, naive: bool = False, shrink: bool = False) -> Run:
    """Bring the joint of Fig. 4 to its limit.

    Raises:
        BadProblemError: (11) is violated, and the bounds are not naive.
    """
    joint = FIG_4
    ticks = round(SECONDS / joint.period_s)
    motion = np.zeros((3, ticks))
    q, dq, after, lower, upper = np.zeros((5, 1))
    a, target = np.zeros(1), np.array([TARGET])
    gains = KP, 2.0 * math.sqrt(KP)
    bounds = joint.bounds(1, periods, shrink=shrink, naive=naive)
    solve = bounds.solve_naive if naive else bounds.solve
    most = np.array([joint.acceleration])
    for k in range(ticks):
        solve(q, dq, lower, upper)
        motion[0, k], motion[1, k] = q[0], dq[0]
        accelerate_to(q, dq, target, *gains, lower, upper, most, joint.period_s, a, after, dq)
        motion[2, k], q[0] = a[0], after[0]
    return Run(joint, *motion)


def run_all() -> Runs:
    """Every motion that a figure or a row shows."""
    try:
        move(TOO_LARGE)
        refused = ""
    except BadProblemError as error:
        refused = str(error)
    return Runs(
        {periods: move(periods, naive=True) for periods in NAIVE},
        {periods: move(periods) for periods in PROPOSED},
        refused,
        move(TOO_LARGE, shrink=True),
    )


def rows(runs: Runs) -> list[Row]:
    """Excess, speed at the limit, and rest."""
    made = []
    why = (
        "The paper says that it violates, and that a larger δt mitigates; next to ours the "
        "oracle's (2), (31) and (32). The paper does not say from where: ours goes from 0, at rest"
    )
    for periods, run in runs.naive.items():
        oracle, item = _oracle(periods, naive=True), f"Fig. 4: naive ×{periods:g},"
        made += [
            near(f"{item} excess over q_max", "violated", run.excess, oracle.excess, why,
                 unit="rad"),
            near(f"{item} speed at q_max", "not zero", run.speed_at_limit, oracle.speed_at_limit,
                 why, unit="rad/s"),
        ]  # fmt: skip
    for periods, run in runs.proposed.items():
        made += _kept(f"Fig. 4: proposed ×{periods:g}", run)
        if periods > 1.0:
            made.append(_rests(f"Fig. 4: proposed ×{periods:g}", run))
    item, first = "Fig. 4: proposed", runs.proposed[1.0]
    reached = "As the paper: reached multiple times, and never at rest there"
    chatter = "As the paper: bounds for δt itself chatter; next to ours the oracle, by halving"
    named = "The paper assumes (11), and 2 rad/s < 20·δt·12 rad/s² violates it: refused by name"
    return [
        *made,
        bounded(f"{item} ×1, arrivals at q_max in 2 s", "multiple times",
                _first(first, SHOWN_S).arrivals, (2.0, None), reached),
        near(f"{item} ×1, rms acceleration, last {LAST_S:g} s of {SHOWN_S:g} s", "never steady",
             first.rms(SHOWN_S), _oracle(1.0, naive=False).rms(SHOWN_S), chatter, unit="rad/s²"),
        bounded(f"{item} ×{TOO_LARGE:g}, errors that name (11)", None,
                float("(11)" in runs.refused), (1.0, 1.0), named),
        *_kept(f"{item} ×{TOO_LARGE:g}, A lowered to (11)", runs.shrunk),
    ]  # fmt: skip


def _oracle(periods: float, *, naive: bool) -> Run:
    """The motion by the oracle."""
    seconds = SECONDS if naive else SHOWN_S
    return Run(FIG_4, *motion(FIG_4, periods, TARGET, KP, seconds, naive=naive))


def _kept(item: str, run: Run) -> list[Row]:
    why = "As the paper: position and velocity bounds are reached, never violated; to rounding"
    return [
        bounded(f"{item}, excess over q_max", 0, run.excess, (None, ROUNDING), why, unit="rad"),
        bounded(f"{item}, excess over dq_max", 0, run.too_fast, (None, ROUNDING), why,
                unit="rad/s"),
    ]  # fmt: skip


def _rests(item: str, run: Run) -> Row:
    return bounded(
        f"{item}, rms acceleration, last {LAST_S:g} s of {SECONDS:g} s",
        "no discontinuities",
        run.rms(SECONDS),
        (None, RESTING),
        "As the paper: bounds for more than δt rest. Near the limit its formulas are 0/0 or kick a "
        "joint that rounding put outside; ours go on smoothly there",
        unit="rad/s²",
    )


def _first(run: Run, seconds: float) -> Run:
    end = round(seconds / run.joint.period_s)
    return Run(run.joint, run.q[:end], run.dq[:end], run.a[:end])
