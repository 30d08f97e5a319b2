"""Rows of Figs. 1 to 5. The paper prints hardly a number."""

from __future__ import annotations

import math

from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.papers.bounds import elbow, joint, oracle
from hoap3.tools.reproduce.rows import NONE, Row, like, row, table

SHARE = 1e-3  # 0.1 percentage points
RESTING = 1e-6  # rad/s², rms
STOPPED = 0.02  # rad/s
NEAR = 5e-3  # of |log(H⁻¹H_d)|

ELBOW_PRINTED = {2.0: (0.36, -1.4), 20.0: (None, -0.3)}
"""Fig. 5, naive: when the elbow reaches its limit [s], and how fast [rad/s], by T_b/δt: caption of
Fig. 5a, and section V-B, which gives 0.3 rad/s without a sign, and no time."""


def rows(
    shares: list[joint.Shares], regions: joint.Regions, runs: joint.Runs, arms: elbow.Runs
) -> list[Row]:
    """All of them."""
    return [
        *viable_rows(),
        *ordering_rows(shares),
        *region_rows(regions),
        *motion_rows(runs),
        *elbow_rows(arms),
    ]


def viable_rows() -> list[Row]:
    """Shares of F."""
    viable = joint.kept()
    reachable = viable & viable[::-1]
    none = "The paper prints no share"
    rolled = f"{none}: ours by braking from {joint.CELLS}² states; beside it the closed form"
    places, speeds = joint.centres(joint.FIG_1, joint.CELLS)
    return table(
        "Fig. 1: ",
        ("|V|/|F|", None, viable.mean(), like(oracle.VIABLE, SHARE), rolled),
        ("|V and reachable|/|F|", None, reachable.mean(), like(oracle.VIABLE_AND_REACHABLE, SHARE),
         rolled),
        ("where the curve of V meets the speed limit", None, places[viable[-1]].max(),
         like(oracle.CURVE_MEETS_SPEED, 2.0 * joint.FIG_1.end / joint.CELLS),
         f"{rolled}: A joint at full speed must brake from 1/6 rad on", "rad"),
        ("states where braking and (10) disagree", None,
         (viable != joint.FIG_1.viable(places, speeds[:, None])).sum(), NONE,
         "As the paper: V = V^c where (11) holds"),
    )  # fmt: skip


def ordering_rows(shares: list[joint.Shares]) -> list[Row]:
    """Which orderings there are, and which there are not."""
    made = []
    first, last, piece = (joint.ORDERINGS[k][0] for k in (0, 3, 2))
    for each in shares:
        turning, position, roots = oracle.turning_share(each.joint), each.position, each.viability
        width = 5.0 * (turning / joint.STATES) ** 0.5 + 1e-5
        others = sum(position[name] for name, _ in joint.ORDERINGS if name not in {first, last})
        made += table(
            f"Fig. 2: δt = {each.joint.period_s:g} s, share of ",
            (first, None, position[first], like(1.0 - turning, width), _EXACT),
            (last, None, position[last], like(turning, width), _EXACT),
            (piece, 0, position[piece], NONE, _NEVER),
            ("the other orderings", "six", others, NONE, _ONLY),
            (f"{joint.ROOTS[0]} in (29)", 0, roots[joint.ROOTS[0]], NONE,
             "As the paper: (29) is never two pieces"),
            (f"{joint.ROOTS[1]} in (29)", None, roots[joint.ROOTS[1]], like(1.0 - turning, width),
             _EXACT),
        )  # fmt: skip
    return made


_NEVER = "As the paper: (22) is never two pieces, though not because V is connected: a₃ ≥ a₂"
_ONLY = "The paper draws six as possible. a₃ − a₂ = v(2x − 1)²/(2xδt) ≥ 0 leaves two"
_EXACT = "The paper prints no share: beside ours the area in the plane of states"


def region_rows(found: joint.Regions) -> list[Row]:
    """Share of each region."""
    shares = oracle.region_shares(joint.FIG_3, joint.SIDE)
    why = f"The paper prints no share: ours of {joint.SIDE}² states, next to it those of the "
    return table(
        "Fig. 3: region ",
        *((f"{number}, {name}, share of F", None, found.share(number), like(known, SHARE),
           f"{why}printed Algorithms 1 to 3")
          for number, (name, known) in enumerate(shares.items())),
    )  # fmt: skip


def motion_rows(runs: joint.Runs) -> list[Row]:
    """Excess, speed at the limit, and rest."""
    made, last, end = [], joint.LAST_S, joint.SHOWN_S
    for periods, run in runs.naive.items():
        known = _oracle(periods, naive=True)
        made += table(
            f"Fig. 4: naive ×{periods:g}, ",
            ("excess over q_max", "violated", run.excess, like(known.excess), _NAIVE, "rad"),
            ("speed at q_max", "not zero", run.speed_at_limit, like(known.speed_at_limit), _NAIVE,
             "rad/s"),
        )  # fmt: skip
    for periods, run in runs.proposed.items():
        item = f"Fig. 4: proposed ×{periods:g}, "
        made += _kept(item, run)
        if periods > 1.0:
            name = f"rms acceleration, last {last:g} s of {joint.SECONDS:g} s"
            made += table(item, (name, "no discontinuities", run.rms(joint.SECONDS),
                                 (None, RESTING), _RESTS, "rad/s²"))  # fmt: skip
    item, first = "Fig. 4: proposed ", runs.proposed[1.0]
    return [
        *made,
        *table(
            item,
            ("×1, arrivals at q_max in 2 s", "multiple times", first.arrivals(end),
             (2.0, None), "As the paper: reached multiple times, and never at rest there"),
            (f"×1, rms acceleration, last {last:g} s of {end:g} s", "never steady",
             first.rms(end), like(_oracle(1.0, naive=False).rms(end)), _CHATTER, "rad/s²"),
            (f"×{joint.TOO_LARGE:g}, errors that name (11)", None, "(11)" in runs.refused,
             (1.0, 1.0), _NAMED),
        ),
        *_kept(f"{item}×{joint.TOO_LARGE:g}, A lowered to (11), ", runs.shrunk),
    ]  # fmt: skip


_NAIVE = (
    "The paper says that it violates, and that a larger δt mitigates; next to ours the oracle's "
    "(2), (31) and (32). The paper does not say from where: ours goes from 0, at rest"
)
_RESTS = (
    "As the paper: bounds for more than δt rest. Near the limit its formulas are 0/0 or kick a "
    "joint that rounding put outside; ours go on smoothly there"
)
_CHATTER = "As the paper: bounds for δt itself chatter; next to ours the oracle, by halving"
_NAMED = "The paper assumes (11), and 2 rad/s < 20·δt·12 rad/s² violates it: refused by name"


def _oracle(periods: float, *, naive: bool) -> joint.Run:
    """The motion by the oracle."""
    seconds = joint.SECONDS if naive else joint.SHOWN_S
    motion = oracle.motion(joint.FIG_4, periods, joint.TARGET, joint.KP, seconds, naive=naive)
    return joint.Run(joint.FIG_4, *motion)


def _kept(item: str, run: joint.Run) -> list[Row]:
    why = "As the paper: position and velocity bounds are reached, never violated; to rounding"
    return table(
        item,
        ("excess over q_max", 0, run.excess, (None, joint.ROUNDING), why, "rad"),
        ("excess over dq_max", 0, run.too_fast, (None, joint.ROUNDING), why, "rad/s"),
    )


def elbow_rows(runs: elbow.Runs) -> list[Row]:
    """When and how fast the elbow meets its limit, and that it does not."""
    e1, shown = load(elbow.ROBOT).joint_names.index(elbow.JOINT), runs.ideal["viability", 2.0]
    none = runs.none == ("left_s1",)
    made = table(
        "Fig. 5: ",
        (f"acceleration of {elbow.JOINT} by Algorithm 4", None, runs.accelerations[e1], None,
         _RANDOM, "rad/s²"),
        ("joints without an acceleration by Algorithm 4", None, 1.0 if none else math.nan,
         (1.0, 1.0), _GRAVITY),
    )  # fmt: skip
    for periods, (time, speed) in ELBOW_PRINTED.items():
        (at, found), fitted = runs.ideal["naive", periods].crossing, "start and goal, for ×2"
        item, differs = f"Fig. 5: naive ×{periods:g}, elbow at its limit,", ""
        if time is None:
            made.append(row(f"{item} time", None, at, None, _TWENTY, "s"))
            differs = _TWENTY
        else:
            made.append(row(f"{item} time", time, at, None, _SOUGHT, "s", fitted=fitted))
        made += [
            row(f"{item} velocity", speed, found, None, _SOUGHT, "rad/s", fitted=fitted,
                differs=differs),
            row(f"{item} crossed", "violated", found < 0.0, (1.0, 1.0),
                "As the paper: the limit is violated"),
        ]  # fmt: skip
    item = "Fig. 5b: proposed ×2, speed of the elbow where it is nearest its limit"
    made.append(row(item, 0, shown.nearest_speed, (None, STOPPED), _ZERO, "rad/s"))
    for periods in elbow.SHOWN["viability"]:
        made += _proposed(f"Fig. 5: proposed ×{periods:g}, ", runs.ideal["viability", periods])
    item = "Fig. 5: proposed ×2, |log(H⁻¹H_d)| that is left after 4 s"
    made.append(row(item, None, shown.error[-1], None, _PULLED))
    return made


def _proposed(item: str, run: elbow.Run) -> list[Row]:
    return table(
        item,
        ("least distance of the elbow from its limit", 0, run.room.min(), (0.0, None),
         "As the paper: no constraint is violated", "rad"),
        ("|log(H⁻¹H_d)| after 4 s", "reached", run.error[-1], (None, NEAR),
         "As the paper: the desired pose is reached"),
        ("ticks at which torques were too small", None, run.fallbacks, NONE,
         "The paper does not say what it does then; ours keeps the bounds and counts"),
    )  # fmt: skip


_RANDOM = (
    "The paper prints none. Random: seeds differ by some per cent, and the worst state is not "
    "among 10⁶"
)
_GRAVITY = (
    "The paper does not say so: gravity alone takes more than the 50 N m of s1, whose spring is in "
    "no model. It is named, and given 2 rad/s²"
)
_ZERO = "As the paper: it reaches its limit with zero velocity; within a step of braking"
_PULLED = "What is left for good: the posture task, w = 10⁻³, pulls back to the start"
_SOUGHT = "The paper prints no posture: ours was sought until both figures were as there"
_TWENTY = (
    "With the postures that were sought for ×2. The paper's are others: it says 0.3 rad/s, and as "
    "ours that the limit is still violated"
)
