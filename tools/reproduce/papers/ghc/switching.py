"""Section 6.1 with targets that stand: the runs of Table 1 and Figs. 1 to 5, and those beside them.

As printed: GHC with transitions of 5 ms and 2 s, and HQP, which changes at once. Its damping is not
printed; ours is 10⁻³. Beside them: GHC with the smoothed projector, on the arm with the ends of its
ranges, and with gravity, where ω_r weighs |τ|², as printed, or |τ − n|².
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.reproduce.papers.ghc.runs import (
    NO_BOUNDS,
    Run,
    follow,
    switching,
    three_tasks,
)
from hoap3.tools.reproduce.rows import Row, bounded, measured

FAST_S, SLOW_S = 0.005, 2.0
"""Durations of transitions in Figs. 3 and 4."""

TABLED = len(ref.TABLE_1["GHC"])  # phases of the table; the last of the figures is not in it
TABLE_S = TABLED * ref.PHASE_S
HQP_DAMPING = 1e-3
SMOOTHING = 0.02
SMALL_W_R = 1e-4


@dataclass(frozen=True, eq=False)
class Switching:
    """All runs.

    Attributes:
        fast, slow, hqp: of Figs. 3, 4 and 2.
        smooth: as `fast`, with the smoothed projector.
        ends: as `fast`, on the real arm's ranges.
        gravity: as `fast`, with gravity, by `regularise`.
        small: only 1 ▷ 3, with gravity, where |τ|² has less weight.
    """

    fast: Run
    slow: Run
    hqp: Run
    smooth: Run
    ends: Run
    gravity: Mapping[str, Run]
    small: Run

    @property
    def shown(self) -> dict[str, Run]:
        """Those of the paper."""
        return {"HQP": self.hqp, "GHC, 5 ms": self.fast, "GHC, 2 s": self.slow}


def run_all(say: Callable[[str], None] = lambda _: None) -> Switching:
    """Every run that a figure or a row shows."""
    say(f"Table 1: GHC, transitions of {FAST_S:g} s and {SLOW_S:g} s")
    fast, slow = switching("ghc", FAST_S), switching("ghc", SLOW_S)
    say("Table 1: HQP")
    hqp = switching("hqp", 0.0, w_r=HQP_DAMPING)
    say("Table 1: smoothed, with ends of the ranges, and with gravity")
    gravity = {
        kind: switching("ghc", FAST_S, TABLE_S, gravity="full", regularise=kind)
        for kind in ("torque", "gravity_compensated")
    }
    return Switching(
        fast,
        slow,
        hqp,
        switching("ghc", FAST_S, TABLE_S, smoothing=SMOOTHING),
        switching("ghc", FAST_S, 3.0 * ref.PHASE_S, ends=True, bounds={}),
        gravity,
        sagging(SMALL_W_R),
    )


def sagging(w_r: float, seconds: float = ref.PHASE_S) -> Run:
    """Only 1 ▷ 3, with gravity and |τ|²."""
    parameters = {
        "tasks": three_tasks(),
        "priorities": {"order": [ref.HAND, ref.POSTURE, ref.ELBOW], "inactive": [ref.ELBOW]},
        "w_r": w_r,
        "regularise": "torque",
        "bounds": NO_BOUNDS,
    }
    return follow("ghc", parameters, seconds, gravity="full")


def jerk_rows(runs: Mapping[str, Run]) -> list[Row]:
    """Fig. 5, and the greatest torques, up to the end of the table or of the shortest run."""
    hqp, fast, slow = (runs[name] for name in ("HQP", "GHC, 5 ms", "GHC, 2 s"))
    last = min(fast.rows(0.0, TABLE_S).stop, *(len(run.q) for run in runs.values())) - 1
    jerk = {name: float(run.jerk[last]) for name, run in runs.items()}
    peak = {name: float(abs(run.tau[: last + 1]).max()) for name, run in runs.items()}
    made = [
        measured(f"Fig. 5: ∫|jerk| over four hierarchies, {name}", None, found, _CURVE,
                 unit="rad/s²")
        for name, found in jerk.items()
    ]  # fmt: skip
    made += [
        bounded("Fig. 5: ∫|jerk|, HQP / GHC 5 ms", "more than 1",
                jerk["HQP"] / jerk["GHC, 5 ms"], (1.0, None),
                "As the paper: HQP jerks more. How much more depends on its damping"),
        bounded("Fig. 5: ∫|jerk|, GHC 5 ms / GHC 2 s", "more than 1",
                jerk["GHC, 5 ms"] / jerk["GHC, 2 s"], (2.0, None),
                "As the paper: slower transitions jerk less"),
    ]  # fmt: skip
    made += [
        measured(f"greatest |τ|, {name}", None, found, "Not in the paper", unit="N m")
        for name, found in peak.items()
    ]
    made.append(
        bounded("greatest |τ|, GHC 5 ms / GHC 2 s", None, peak["GHC, 5 ms"] / peak["GHC, 2 s"],
                (1.0, None), "Not in the paper. Slower transitions need less torque")
    )  # fmt: skip
    made += [
        bounded(f"Table 1: ticks without an answer, {name}", None, run.fallbacks, (0.0, 0.0),
                "Every problem has an answer")
        for name, run in (("HQP", hqp), ("GHC 5 ms", fast), ("GHC 2 s", slow))
    ]  # fmt: skip
    return made


_CURVE = (
    "The paper shows a curve without figures; inertia, start and targets, on which it depends, are "
    f"not printed. Qualitative: only the order is judged. HQP with damping {HQP_DAMPING:g}, GHC "
    f"with ω_r = {ref.W_R:g}"
)
