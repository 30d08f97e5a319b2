"""Fig. 2: how often each ordering of the accelerations occurs that Algorithms 1 and 2 compare.

The paper draws what could be; here it is counted, over random viable states with the limits of
Fig. 3 and several δt. With D = q_max − q, v = dq > 0 and x = D/(vδt),

    a₁ = −v/δt,   a₂ = −v²/(2D) = a₁/(2x),   a₃ = 2(D − vδt)/δt² = −2a₁(x − 1)

so that a₃ − a₂ = v(2x − 1)²/(2xδt) ≥ 0: of six orderings two are left, one for x > ½ and one for
x < ½, and what (22) allows is never disconnected. While v ≤ 0 the bound is a₃ alone. For (24),
in terms of w = v + δt·ddq, the product of the roots is −2AE with E = D − vδt/2. Where E ≥ 0 one is
on either side of a₁, where E < 0 both are below it, or there are none: never both above.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.bounds.joint import FIG_3, Joint
from hoap3.tools.reproduce.papers.bounds.reference import turning_share
from hoap3.tools.reproduce.rows import Row, bounded, near

STATES = 1_000_000
PERIODS_S = (0.02, 0.05, 0.1, 0.2)
"""Up to what (11) allows."""

SEED = 0

POSITION = (
    ("a₁ < a₂ < a₃", (1, 2, 3)),
    ("a₁ < a₃ < a₂", (1, 3, 2)),
    ("a₂ < a₁ < a₃", (2, 1, 3)),
    ("a₂ < a₃ < a₁", (2, 3, 1)),
    ("a₃ < a₁ < a₂", (3, 1, 2)),
    ("a₃ < a₂ < a₁", (3, 2, 1)),
)
"""Of (17), (19) and (20); the third would leave two pieces."""

VIABILITY = ("a₁ < a₂ ≤ a₃", "a₂ ≤ a₁ ≤ a₃", "a₂ ≤ a₃ < a₁", "no roots")
"""Of (25) and (28); the first would leave two pieces."""


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
    position = {name: float((order == wanted).all(axis=1).mean()) for name, wanted in POSITION}
    b, c = T * (2.0 * dq + T * A), dq * dq - 2.0 * A * (room - T * dq)
    square = b * b - 4.0 * T * T * c
    root = np.sqrt(np.maximum(square, 0.0))
    low, high = (-b - root) / (2.0 * T * T), (-b + root) / (2.0 * T * T)
    real = square >= 0.0
    cases = (real & (low > a1), real & (low <= a1) & (a1 <= high), real & (high < a1), ~real)
    viability = {name: float(case.mean()) for name, case in zip(VIABILITY, cases, strict=True)}
    return Shares(joint, position, viability)


def count_all() -> list[Shares]:
    """For every δt, over the same states."""
    made = []
    for period in PERIODS_S:
        joint = Joint(FIG_3.end, FIG_3.speed, FIG_3.acceleration, period)
        made.append(count(joint, *random_states(joint)))
    return made


def rows(shares: list[Shares]) -> list[Row]:
    """Which orderings there are, and which there are not."""
    made = []
    first, last, piece = (POSITION[k][0] for k in (0, 3, 2))
    never = "As the paper: (22) is never two pieces, though not because V is connected: a₃ ≥ a₂"
    only = "The paper draws six as possible. a₃ − a₂ = v(2x − 1)²/(2xδt) ≥ 0 leaves two"
    exact = "The paper prints no share: beside ours the area in the plane of states"
    for each in shares:
        item, turning = f"Fig. 2: δt = {each.joint.period_s:g} s,", turning_share(each.joint)
        width = 5.0 * (turning / STATES) ** 0.5 + 1e-5
        others = sum(each.position[name] for name, _ in POSITION if name not in {first, last})
        made += [
            near(f"{item} share of {first}", None, each.position[first], 1.0 - turning, exact,
                 absolute=width),
            near(f"{item} share of {last}", None, each.position[last], turning, exact,
                 absolute=width),
            bounded(f"{item} share of {piece}", 0, each.position[piece], (0.0, 0.0), never),
            bounded(f"{item} share of the other orderings", "six", others, (0.0, 0.0), only),
            bounded(f"{item} share of {VIABILITY[0]} in (29)", 0, each.viability[VIABILITY[0]],
                    (0.0, 0.0), "As the paper: (29) is never two pieces"),
            near(f"{item} share of {VIABILITY[1]} in (29)", None, each.viability[VIABILITY[1]],
                 1.0 - turning, exact, absolute=width),
        ]  # fmt: skip
    return made


def draw(shares: list[Shares]) -> Figure:
    """Shares by ordering; those that never occur stay empty."""

    def panel(name: str, title: str, names: tuple[str, ...], part: str) -> Panel:
        curves = []
        marks = zip(shares, COLOURS, "so^D", np.linspace(-0.15, 0.15, len(shares)), strict=False)
        for each, colour, marker, aside in marks:
            found = getattr(each, part)
            values = np.array([found[case] for case in names])
            some = values > 0.0
            places = np.arange(len(names), dtype=np.float64)[some] + aside
            label = f"δt = {each.joint.period_s:g} s"
            curves.append(Curve(label, places, values[some], colour, dash="", marker=marker))
        return Panel(
            name,
            title,
            Axis("ordering", "", (-0.5, len(names) - 0.5)),
            Axis("share", "share of the viable states with dq > 0", (1e-6, 3.0), log=True),
            curves,
            categories=tuple(case.replace(" < ", "<").replace(" ≤ ", "≤") for case in names),
        )

    rows = (
        panel("a", "(a) Algorithm 1: four of six never occur",
              tuple(name for name, _ in POSITION), "position"),
        panel("b", "(b) Algorithm 2: the first never occurs", VIABILITY, "viability"),
    )  # fmt: skip
    title = f"Fig. 2: orderings of the accelerations, {STATES:.0e} random states".replace("+0", "")
    return Figure("fig2", title, (rows,), (11.0, 4.2))
