"""Fig. 11: two tasks without strict priority, beside the weighting strategy (12).

Errors are means over the last half second; the arm is not at rest there, since two position tasks
leave one joint motion free.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, lines
from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.reproduce.papers.ghc.runs import END_S, NO_BOUNDS, follow, point, position
from hoap3.tools.reproduce.rows import Row, bounded, measured

SECONDS, WEIGHED_SECONDS = 8.0, 6.0
STRICT_M, NEVER_M = 1e-3, 1e-3
EVEN = (0.5, 2.0)

Errors = Mapping[float, tuple[float, float]]


def tasks() -> list[dict[str, object]]:
    """Hand and elbow."""
    return [position(ref.HAND, point(ref.HAND_M)), position(ref.ELBOW, point(ref.ELBOW_M))]


def compromise(alpha: float, seconds: float = SECONDS) -> tuple[float, float]:
    """Errors of hand and elbow with α₁₂ and α₂₁ = 1 − α₁₂ [m]."""
    return _errors("ghc", {"matrix": [[0.0, alpha], [1.0 - alpha, 0.0]]}, seconds)


def weigh(ratio: float, seconds: float = WEIGHED_SECONDS) -> tuple[float, float]:
    """Errors of hand and elbow with weights ω₁/ω₂ [m]."""
    return _errors("weighted", {"weights": {ref.HAND: ratio, ref.ELBOW: 1.0}}, seconds)


def _errors(controller: str, priorities: dict[str, Any], seconds: float) -> tuple[float, float]:
    given = {"tasks": tasks(), "priorities": priorities, "w_r": ref.W_R, "regularise": "torque"}
    run = follow(controller, {**given, "bounds": NO_BOUNDS}, seconds)
    last = slice(-round(END_S / run.period_s), None)
    hand, elbow = (float(run.errors[name][last].mean()) for name in (ref.HAND, ref.ELBOW))
    return hand, elbow


def run_all(say: Callable[[str], None] = lambda _: None) -> tuple[Errors, Errors]:
    """Errors by α₁₂, and by ω₁/ω₂."""
    say("Fig. 11: two tasks, and their weights")
    by_alpha = {alpha: compromise(alpha) for alpha in ref.COMPROMISES}
    return by_alpha, {ratio: weigh(ratio) for ratio in ref.WEIGHED}


def rows(by_alpha: Errors, by_weight: Errors) -> list[Row]:
    """Each error, monotony, and whether the ends are strict."""
    made = [
        row
        for alpha, found in by_alpha.items()
        for row in _each(f"Fig. 11: α₁₂ = {alpha:g}", found, _SCALE)
    ]
    for alpha, task, place in ((0.0, ref.HAND, 0), (1.0, ref.ELBOW, 1)):
        item = f"Fig. 11: α₁₂ = {alpha:g}, {task} alone has priority: its error"
        error = by_alpha[alpha][place]
        made.append(bounded(item, 0, error, (None, STRICT_M), _STRICT, unit="m"))
    steps = np.diff(np.array([by_alpha[alpha] for alpha in sorted(by_alpha)]), axis=0)
    made += [
        bounded("Fig. 11: hand, least step from one α₁₂ to the next", "increases",
                float(steps[:, 0].min()), (0.0, None), _MONOTONE, unit="m"),
        bounded("Fig. 11: elbow, greatest step from one α₁₂ to the next", "decreases",
                float(steps[:, 1].max()), (None, 0.0), _MONOTONE, unit="m"),
    ]  # fmt: skip
    if 0.5 in by_alpha:
        hand, elbow = by_alpha[0.5]
        made.append(
            bounded("Fig. 11: α₁₂ = 0.5, hand / elbow", "more or less equal", hand / elbow, EVEN,
                    "As the paper: more or less an equal compromise")
        )  # fmt: skip
    for ratio, found in by_weight.items():
        made += _each(f"Fig. 11 by weights: ω₁/ω₂ = {ratio:g}", found, _BASELINE)
    least = min(min(found) for found in by_weight.values())
    made.append(
        bounded("Fig. 11 by weights: least error of any task", None, least, (NEVER_M, None),
                "As the paper says of weights: never strict", unit="m")
    )  # fmt: skip
    return made


def _each(item: str, found: Sequence[float], why: str) -> list[Row]:
    return [
        measured(f"{item}, {name}", None, ours, why, unit="m")
        for name, ours in zip((ref.HAND, ref.ELBOW), found, strict=True)
    ]


def draw(by_alpha: Errors, by_weight: Errors) -> Figure:
    """Errors over α₁₂, and one over the other."""
    alphas = np.array(sorted(by_alpha))
    ours = np.array([by_alpha[alpha] for alpha in alphas.tolist()])
    weights = np.array([by_weight[ratio] for ratio in by_weight])
    tasks = {name: (alphas, ours[:, i]) for i, name in enumerate((ref.HAND, ref.ELBOW))}
    over = Panel(
        "alpha",
        "α₂₁ = 1 − α₁₂",
        Axis("alpha_12", "α₁₂ [1]"),
        Axis("error_m", "error [m]"),
        lines(tasks, marker="o"),
    )
    beside = Panel(
        "tradeoff",
        "GHC and the weighting strategy",
        Axis("hand_m", "error of the hand [m]"),
        Axis("elbow_m", "error of the elbow [m]"),
        [
            Curve("GHC, α₁₂ = 0 … 1", ours[:, 0], ours[:, 1], COLOURS[2], marker="o"),
            Curve(
                "weights, ω₁/ω₂ = 100 … 0.01", weights[:, 0], weights[:, 1], dash="--", marker="s"
            ),
        ],
    )
    title = "Fig. 11: hand and elbow without strict priority"
    return Figure("fig11", title, [[over, beside]], (12.0, 4.5))


_SCALE = "The paper shows curves for 0.2, 0.5 and 0.8, of targets that are not printed"
_STRICT = "As the paper: α = 0 or 1 is a strict priority"
_MONOTONE = "As the paper: a greater α₁₂ improves the elbow at the expense of the hand"
_BASELINE = "Not in the paper's figure: (12)"
