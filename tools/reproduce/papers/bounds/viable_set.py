"""Fig. 1: the viable set V^c within the feasible set F, and what velocity control leaves of it.

V^c is found without (10): from each state of a grid the joint brakes as the shipped bounds allow,
and either never leaves F, also between the ticks, or does. Reachable is what is viable with time
running backwards. The shares of F have closed forms: √(2AD) cuts off a corner of V³/(6A) on each
side, so that with ends at ±Q

    |V^c|/|F| = 1 − V²/(12·A·Q)

The paper does not print the formulas of [5] and [6]. [6] assumes velocity control: a velocity w is
held for δt, and may change by A·δt from one period to the next. Among all that this allows, the
fastest from which a joint with the room D stops in time, in n periods, is

    w(D) = (D/δt + A·δt·n(n−1)/2)/n,   n = ⌈(√(1 + 8D/(A·δt²)) − 1)/2⌉

which is drawn for it: the most that any method for velocity control can allow. [5] is said to be
continuous and conservative even so. √(2AD) − A·δt/2 is, and touches w(D) from below in every of
its pieces; it stands for [5], without being its formula.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.reproduce.figures import COLOURS, INK, PALE, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.bounds import reference as ref
from hoap3.tools.reproduce.papers.bounds.joint import FIG_1, Joint
from hoap3.tools.reproduce.rows import Row, bounded, near

CELLS = 400  # of F, along q and along dq
STEPS = 0.01  # s: of the braking
PERIODS_S = (0.01, 0.1)  # of velocity control
SHARE = 1e-3  # 0.1 percentage points
SHARES_OVER = 200_000  # positions, for the area below a curve


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


def velocity_control(room: Array, A: float, T: float) -> Array:
    """w(D): the fastest velocity from which a joint stops in time, by steps of A·T."""
    n = np.maximum(1.0, np.ceil((np.sqrt(1.0 + 8.0 * room / (A * T * T)) - 1.0) / 2.0))
    return np.asarray((room / T + A * T * n * (n - 1.0) / 2.0) / n)


def smooth(room: Array, A: float, T: float) -> Array:
    """√(2AD) − AT/2, below w(D) everywhere; 0 where that is negative."""
    return np.asarray(np.maximum(0.0, np.sqrt(2.0 * A * room) - 0.5 * A * T))


def share_below(joint: Joint, fastest: Array) -> float:
    """Share of F where −fastest(−q) ≤ dq ≤ fastest(q), for positions evenly from end to end."""
    return float(np.minimum(fastest, joint.speed).mean()) / joint.speed


_SMOOTH = (
    "The paper does not print the formula of [5]: √(2AD) − A·δt/2 is continuous and conservative, "
    "as it is said to be"
)


def rows() -> list[Row]:
    """Shares of F."""
    joint, viable = FIG_1, kept()
    reachable = viable & viable[::-1]
    none = "The paper prints no share"
    rolled = f"{none}: ours by braking from {CELLS}² states; beside it the closed form"
    places, speeds = centres(joint, CELLS)
    fastest = places[viable[-1]].max()
    made = [
        near("Fig. 1: |V|/|F|", None, viable.mean(), ref.VIABLE, rolled, absolute=SHARE),
        near("Fig. 1: |V and reachable|/|F|", None, reachable.mean(), ref.VIABLE_AND_REACHABLE,
             rolled, absolute=SHARE),
        near("Fig. 1: where the curve of V meets the speed limit", None, fastest,
             ref.CURVE_MEETS_SPEED, f"{rolled}: A joint at full speed must brake from 1/6 rad on",
             unit="rad", absolute=2.0 * joint.end / CELLS),
        bounded("Fig. 1: states where braking and (10) disagree", None,
                float((viable != joint.viable(places, speeds[:, None])).sum()), (0.0, 0.0),
                "As the paper: V = V^c where (11) holds"),
    ]  # fmt: skip
    room = (np.arange(SHARES_OVER) + 0.5) / SHARES_OVER * 2.0 * joint.end
    for period in PERIODS_S:
        reference = ref.velocity_control_share(period)
        w = velocity_control(room, joint.acceleration, period)
        share = share_below(joint, w)
        why = (
            "The paper does not say δt, nor the formula of [6]: ours is the most that velocity "
            "control allows, without the discontinuity that the paper sees in [6]"
        )
        item = f"Fig. 1: curve of [6], share of F, δt = {period:g} s"
        made.append(near(item, None, share, reference, why, absolute=SHARE))
        less = share_below(joint, smooth(room, joint.acceleration, period))
        said = "conservative even for velocity control"
        item = f"Fig. 1: curve for [5], share of F, δt = {period:g} s"
        made.append(bounded(item, said, less, (None, share), _SMOOTH))
    return made


def draw() -> Figure:
    """States, and the curves that bound them."""
    joint = FIG_1
    A, T, Q, V = joint.acceleration, joint.period_s, joint.end, joint.speed
    q, fastest = joint.stopping_speed
    around = np.concatenate([q, -q]), np.concatenate([fastest, -fastest])
    box = np.array([-Q, Q, Q, -Q, -Q]), np.array([-V, -V, V, V, -V])
    fine = np.linspace(-Q, Q, 2001)
    room = Q - fine

    def both(label: str, speeds: Array, colour: str, dash: str) -> tuple[Curve, Curve]:
        slow = speeds <= V
        x, y = fine[slow], speeds[slow]
        return (
            Curve(label, x, y, colour, dash=dash),
            Curve(f"{label}, below", -x, -y, colour, dash=dash, legend=""),
        )

    curves = [
        Curve("feasible set F", *box, PALE, "area"),
        Curve("viable set V", *around, COLOURS[0], "area", fill="#D5E8F3"),
        *both("velocity control, for [6]", velocity_control(room, A, T), COLOURS[1], "-"),
        *both("smooth and below it, for [5]", smooth(room, A, T), COLOURS[2], "-"),
        *both("reachable: full acceleration from the wall", np.sqrt(2.0 * A * (Q + fine)), INK,
              ":"),
    ]  # fmt: skip
    corner = [replace(curve, marker="", legend="") for curve in curves]
    horizontal, vertical = ("q_rad", "q [rad]"), ("dq_rad_per_s", "dq [rad/s]")
    panels = (
        Panel("", f"Q = {Q:g} rad, V = {V:g} rad/s, A = {A:g} rad/s²; curves of others at "
              f"δt = {T:g} s", Axis(*horizontal, (-1.1 * Q, 1.1 * Q), 0.5),
              Axis(*vertical, (-1.15 * V, 1.15 * V), 1.0), curves),
        Panel("wall", "the same near the upper limit", Axis(*horizontal, (0.6 * Q, 1.02 * Q), 0.1),
              Axis(*vertical, (-0.2, 0.72 * V), 1.0), corner),
    )  # fmt: skip
    return Figure("fig1", "Fig. 1: states of one joint that are viable", (panels,), (14.0, 5.0))
