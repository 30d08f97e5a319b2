"""One joint with the same limits either way: sets of states, Figs. 1 to 3, and motions, Fig. 4.

Fig. 1: V^c is found without (10): from each state of a grid the joint brakes as the shipped bounds
allow, and either never leaves F, also between the ticks, or does. Reachable is what is viable with
time running backwards. √(2AD) cuts off a corner of V³/(6A) on each side, so that with ends at ±Q

    |V^c|/|F| = 1 − V²/(12·A·Q)

Fig. 2: how often each ordering of the accelerations occurs that Algorithms 1 and 2 compare.

The paper draws what could be; here it is counted, over random viable states with the limits of
Fig. 3 and several δt. With D = q_max − q, v = dq > 0 and x = D/(vδt),

    a₁ = −v/δt,   a₂ = −v²/(2D) = a₁/(2x),   a₃ = 2(D − vδt)/δt² = −2a₁(x − 1)

so that a₃ − a₂ = v(2x − 1)²/(2xδt) ≥ 0: of six orderings two are left, one for x > ½ and one for
x < ½, and what (22) allows is never disconnected. While v ≤ 0 the bound is a₃ alone. For (24),
in terms of w = v + δt·ddq, the product of the roots is −2AE with E = D − vδt/2. Where E ≥ 0 one is
on either side of a₁, where E < 0 both are below it, or there are none: never both above.

Fig. 3: which upper bound of the acceleration is the least, state by state.

Fig. 4: to the upper limit by (31) and (32), within naive and within viable bounds. The joint
integrates exactly what is commanded, (1), by the kernel of the shipped controller
`joint_acceleration`, with the paper's gains. The target is 0.1 rad above the limit, as section V-A
prints. Where it starts is not printed: ours is at rest in the middle of its range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.remote_controller.controllers.acceleration.joint_acceleration_kernels import (
    accelerate_to,
)
from hoap3.tools.reproduce.figures import Array

CELLS = 400  # of F, along q and along dq
STEPS = 0.01  # s: of the braking

STATES = 1_000_000
ORDERED_PERIODS_S = (0.02, 0.05, 0.1, 0.2)
"""Up to what (11) allows."""

SEED = 0

ORDERINGS = tuple(
    (" < ".join(f"a{'₀₁₂₃'[k]}" for k in order), order) for order in permutations((1, 2, 3))
)
"""Of (17), (19) and (20); the third would leave two pieces."""

ROOTS = ("a₁ < a₂ ≤ a₃", "a₂ ≤ a₁ ≤ a₃", "a₂ ≤ a₃ < a₁", "no roots")
"""Of (25) and (28); the first would leave two pieces."""

SIDE = 2001  # states along q and along dq, ends included

UNREACHABLE, NOT_VIABLE, POSITION, VELOCITY, MAXIMUM, VIABILITY = range(6)
"""Numbers of the regions, as in the paper."""


@dataclass(frozen=True)
class Joint:
    """Limits of a joint, and the periods of its controller.

    Attributes:
        end: q_max = −q_min [rad].
        speed: dq_max [rad/s].
        acceleration: ddq_max [rad/s²].
        period_s: δt [s].
    """

    end: float
    speed: float
    acceleration: float
    period_s: float

    def bounds(
        self, states: int, periods: float = 1.0, *, shrink: bool = False, naive: bool = False
    ) -> AccelerationBounds:
        """The shipped bounds, for many states of this joint at once.

        Args:
            states: how many.
            periods: T_b/δt.
            shrink: whether the acceleration is lowered to satisfy (11).
            naive: for `solve_naive` only.

        Raises:
            BadProblemError: (11) is violated, and they are not naive.
        """
        ends = np.full(states, self.end)
        return AccelerationBounds(
            -ends,
            ends,
            self.speed,
            self.acceleration,
            self.period_s,
            horizon_s=periods * self.period_s,
            shrink=shrink,
            naive=naive,
        )

    def viable(self, q: Array, dq: Array) -> NDArray[np.bool_]:
        """(8) to (10): fast, and yet able to stop before the limit, for feasible states."""
        room = np.where(dq > 0.0, self.end - q, self.end + q)
        return np.asarray(dq * dq <= 2.0 * self.acceleration * room)

    def reachable(self, q: Array, dq: Array) -> NDArray[np.bool_]:
        """Whether there is a way into a state from rest: out of its mirror image in time."""
        return self.viable(q, -dq)

    @property
    def stopping_speed(self) -> tuple[Array, Array]:
        """Positions from end to end, dense where it is steep, and dq_M of (8); both (401,)."""
        q = self.end * (1.0 - 2.0 * np.linspace(1.0, 0.0, 401) ** 2)
        return q, np.minimum(self.speed, np.sqrt(2.0 * self.acceleration * (self.end - q)))


FIG_1 = Joint(end=1.0, speed=5.0, acceleration=15.0, period_s=0.1)
FIG_3 = Joint(end=0.5, speed=2.0, acceleration=10.0, period_s=0.1)
FIG_4 = Joint(end=2.0, speed=2.0, acceleration=12.0, period_s=0.01)

KP = 1000.0  # 1/s²
TARGET = FIG_4.end + 0.1  # rad, section V-A
SECONDS = 6.0
SHOWN_S = 2.0
LAST_S = 0.5
ROUNDING = 1e-12  # rad and rad/s

NAIVE = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0)
PROPOSED = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
TOO_LARGE = 20.0
"""T_b/δt with which (11) is violated: 2 rad/s < 20·0.01·12."""


def kept(joint: Joint = FIG_1, cells: int = CELLS) -> NDArray[np.bool_]:
    """Which states a braking joint never leaves F from, (cells of dq, cells of q).

    The states are the centres of the cells.
    """
    places, speeds = centres(joint, cells)
    fine = Joint(joint.end, joint.speed, joint.acceleration, STEPS)
    bounds = fine.bounds(cells)
    lower, upper = np.zeros(cells), np.zeros(cells)
    found = np.zeros((cells, cells), bool)
    steps = math.ceil(joint.speed / (joint.acceleration * STEPS)) + 1
    for row, speed in enumerate(speeds):
        q, dq = places.copy(), np.full(cells, speed)
        farthest = np.abs(q)
        for _ in range(steps):
            bounds.solve(q, dq, lower, upper)
            a = np.clip(-dq / STEPS, lower, upper)
            farthest = np.maximum(farthest, np.abs(peak(q, dq, a, STEPS)))
            q += STEPS * dq + 0.5 * STEPS**2 * a
            dq += STEPS * a
        found[row] = farthest <= joint.end * (1.0 + 1e-9)
    return found


def peak(q: Array, dq: Array, a: Array, T: float) -> Array:
    """Where a joint turns round within T, or else where it is after T."""
    after = dq + T * a
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = q - 0.5 * dq * dq / a
    return np.asarray(np.where(dq * after < 0.0, turning, q + T * dq + 0.5 * T * T * a))


def centres(joint: Joint, cells: int) -> tuple[Array, Array]:
    """Positions and velocities in the middle of each cell of F."""
    middle = (np.arange(cells) + 0.5) / cells * 2.0 - 1.0
    return joint.end * middle, joint.speed * middle


@dataclass(frozen=True)
class Shares:
    """Of the viable states with dq > 0.

    Attributes:
        joint: its limits, and δt.
        position, viability: share of each ordering, by name.
    """

    joint: Joint
    position: Mapping[str, float]
    viability: Mapping[str, float]


def random_states(joint: Joint, count: int = STATES) -> tuple[Array, Array]:
    """Viable states with dq > 0, evenly over them: q and dq, at most (count,)."""
    rng = np.random.default_rng(SEED)
    q = rng.uniform(-joint.end, joint.end, count)
    dq = joint.speed * (1.0 - rng.random(count))
    viable = joint.viable(q, dq)
    return q[viable], dq[viable]


def count(joint: Joint, q: Array, dq: Array) -> Shares:
    """Shares of each ordering, for states with dq > 0."""
    T, A, room = joint.period_s, joint.acceleration, joint.end - q
    a1, a2, a3 = -dq / T, -dq * dq / (2.0 * room), 2.0 * (room - T * dq) / T**2
    order = 1 + np.argsort(np.stack([a1, a2, a3]), axis=0, kind="stable").T
    position = {name: float((order == wanted).all(axis=1).mean()) for name, wanted in ORDERINGS}
    b, c = T * (2.0 * dq + T * A), dq * dq - 2.0 * A * (room - T * dq)
    square = b * b - 4.0 * T * T * c
    root = np.sqrt(np.maximum(square, 0.0))
    low, high = (-b - root) / (2.0 * T * T), (-b + root) / (2.0 * T * T)
    real = square >= 0.0
    cases = (real & (low > a1), real & (low <= a1) & (a1 <= high), real & (high < a1), ~real)
    viability = {name: float(case.mean()) for name, case in zip(ROOTS, cases, strict=True)}
    return Shares(joint, position, viability)


def count_all() -> list[Shares]:
    """For every δt, over the same states."""
    made = []
    for period in ORDERED_PERIODS_S:
        joint = Joint(FIG_3.end, FIG_3.speed, FIG_3.acceleration, period)
        made.append(count(joint, *random_states(joint)))
    return made


@dataclass(frozen=True, eq=False)
class Regions:
    """A grid of states of one joint.

    Attributes:
        q, dq: positions (columns) and velocities (rows).
        region: number of each state's, (rows, columns).
    """

    q: Array
    dq: Array
    region: NDArray[np.int8]

    def share(self, number: int) -> float:
        """Of all states."""
        return float((self.region == number).mean())


def classify(joint: Joint = FIG_3, side: int = SIDE) -> Regions:
    """Which term of the shipped bounds is the least, state by state."""
    q, speeds = joint.end * np.linspace(-1.0, 1.0, side), joint.speed * np.linspace(-1.0, 1.0, side)
    bounds, T = joint.bounds(side), joint.period_s
    lower, upper = np.zeros(side), np.zeros(side)
    region = np.empty((side, side), np.int8)
    for row, speed in zip(region, speeds, strict=True):
        dq = np.full(side, speed)
        bounds.solve(q, dq, lower, upper)
        row[:] = VIABILITY
        row[joint.end - q < T * speed / 2.0] = POSITION  # turns round within δt
        row[upper == (joint.speed - speed) / T] = VELOCITY
        row[upper == joint.acceleration] = MAXIMUM
        row[~joint.viable(q, dq)] = NOT_VIABLE
        row[~joint.reachable(q, dq)] = UNREACHABLE
    return Regions(q, speeds, region)


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

    def arrivals(self, seconds: float) -> int:
        """How often it reaches q_max within a time."""
        there = (self.joint.end - self.q < 1e-6)[: round(seconds / self.joint.period_s)]
        return int((there[1:] & ~there[:-1]).sum())


@dataclass(frozen=True)
class Runs:
    """All of them, by T_b/δt.

    Attributes:
        naive: within (2).
        proposed: within Algorithm 3.
        refused: what `TOO_LARGE` is answered with.
        shrunk: with it, and the acceleration lowered to satisfy (11).
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
