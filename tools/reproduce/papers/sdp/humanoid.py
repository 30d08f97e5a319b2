"""A humanoid, which the paper names and does not have: what weights of V make of β.

The tasks are those of `clik_sdp_humanoid`, the swinging foot, the centre of mass and the hand, with
its weights and with equal ones, by Euler's method at the robot's period.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains
from hoap3.tools.reproduce.figures import Axis, Figure, Panel, column, lines
from hoap3.tools.reproduce.papers.sdp.claims import LESS
from hoap3.tools.reproduce.papers.sdp.configured import ConfiguredTasks
from hoap3.tools.reproduce.papers.sdp.loop import Run, follow
from hoap3.tools.reproduce.rows import Row, bounded, measured

CONFIG, ROBOT = "clik_sdp_humanoid", "humanoid32"
HAND = "hand"
FRAMES = {"r_sole": "the standing foot", "pelvis": "the pelvis"}
"""What the hand's target may be relative to."""

STANDING = "r_sole"
SECONDS = 2.0
COMPARED_S = (0.0, 0.5)
BETTER = 10.0


@dataclass(frozen=True)
class Pair:
    """The same with the config's weights, and with equal ones.

    Attributes:
        weighted, equal: the runs.
        sizes: rows of each task.
        shipped: whether the config has the hand's target so.
    """

    weighted: Run
    equal: Run
    sizes: tuple[int, ...]
    shipped: bool

    def better(self, time_s: float) -> float:
        """β with weights / without."""
        step = self.weighted.at(time_s)
        return float(self.weighted.beta[step] / self.equal.beta[step])


def run(frame: str, seconds: float = SECONDS) -> Pair:
    """Go with the hand's target relative to a frame."""
    tasks = ConfiguredTasks(CONFIG, ROBOT, seen_from={HAND: frame})
    runs = []
    for weights in (tasks.weights, np.ones(len(tasks.weights))):
        solver = SdpGains(tasks.sizes, tasks.robot.n, weights=weights)
        solver.lower[:], solver.upper[:] = -tasks.robot.velocity, tasks.robot.velocity
        period = tasks.robot.period_s
        runs.append(follow(tasks, tasks.start, solver, period, tasks.desired, seconds))
    shipped = tasks.references[HAND] == frame
    return Pair(runs[0], runs[1], tuple(tasks.sizes), shipped)


def run_all(say: Callable[[str], None] = lambda _: None) -> dict[str, Pair]:
    """By what the hand is seen from."""
    say("A humanoid with and without weights")
    return {frame: run(frame) for frame in FRAMES}


def rows(pairs: Mapping[str, Pair]) -> list[Row]:
    """How much better weights make β: judged as in the reference, and as the config ships."""
    made = []
    for frame, pair in pairs.items():
        shipped = ", as shipped" if pair.shipped else ""
        name = f"humanoid, hand seen from {FRAMES[frame]}{shipped}"
        why = _WEIGHTS if frame == STANDING else _ALONE
        for time in COMPARED_S:
            step = pair.equal.at(time)
            made.append(
                measured(f"{name}: β({time:g} s), equal weights", None,
                         float(pair.equal.beta[step]), why, unit="1/s")
            )  # fmt: skip
            item = f"{name}: β({time:g} s), with weights / equal"
            if pair.shipped or frame == STANDING:
                better = pair.better(time)
                made.append(bounded(item, None, better, (BETTER, None), why))
            else:
                made.append(measured(item, None, pair.better(time), why))
        made += [
            bounded(f"{name}: V⁺/V, greatest, {kind}", None, each.rise, (None, LESS), _CERTIFIED)
            for kind, each in (("with weights", pair.weighted), ("equal weights", pair.equal))
        ]
    return made


def draw(pairs: Mapping[str, Pair]) -> Figure:
    """β over time."""
    panels = []
    for frame, pair in pairs.items():
        runs = {"with the config's weights": pair.weighted, "equal weights": pair.equal}
        curves = lines({label: (each.time_s, each.beta) for label, each in runs.items()})
        beta = Axis("beta_per_s", "β [1/s]", (1e-3, 1.0), log=True)
        title = f"the hand seen from {FRAMES[frame]}"
        panels.append(Panel(frame, title, Axis("time_s", "time [s]"), beta, curves))
    title = "A humanoid: foot, centre of mass, hand"
    return column("humanoid", title, panels, (9.0, 6.0))


_WEIGHTS = (
    "Not in the paper, which proposes the method for humanoids and shows none: with equal weights "
    "the proof is so weak that the robot hardly moves. Weights that fall with the priority cost "
    "nothing; a tenfold β was found for another humanoid, all of whose tasks were seen from the "
    "standing foot"
)
_ALONE = (
    "Not in the paper. Seen from the pelvis the hand does not feel the legs, so that there is less "
    "that equal weights spoil: they are 14 times better than with the hand seen from the foot"
)
_CERTIFIED = "V falls at every step, with its own weights"
