"""Table I: times of QP12, PINV and OSQP. Ours are measurements; only their order is judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.tools.bench.solvers import PAPER_US
from hoap3.tools.reproduce.figures import COLOURS, INK, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.qp12 import oracle
from hoap3.tools.reproduce.rows import Row, bounded, measured

SOLVERS = {"qp12": "QP12", "pinv_svd": "PINV by SVD", "pinv": "PINV by Cholesky", "osqp": "OSQP"}
PAPERS_NAMES = {"qp12": "qp12", "pinv_svd": "pinv", "osqp": "osqp"}
FIGURES = ("min", "mean", "max")
KINDS = {"batches of 10": "batch_", "single calls": ""}

_JULIA = "Ours is Python on this machine, the paper's Julia 1.0 on a 3.1 GHz Core i7"
_WHY = {
    "qp12": f"{_JULIA}. With checks and the KKT residual; the gradient changes at every call",
    "pinv_svd": f"{_JULIA}. Three equations by an SVD, against one equation for QP12",
    "pinv": "The same answer as by SVD, without one: not in the paper",
    "osqp": f"{_JULIA}. Set up once, updated and warm, not polished",
}
_MEDIAN = "; the mean is the median of the batches' means"


def rows(timed: Sequence[dict[str, Any]]) -> list[Row]:
    """Rows from those of `bench_solvers`."""
    by_name = {row["solver"]: row for row in timed}
    found = []
    for solver, name in SOLVERS.items():
        paper = PAPER_US.get(PAPERS_NAMES.get(solver, ""), {})
        for kind, prefix in KINDS.items():
            for figure in FIGURES:
                why = _WHY[solver] + (_MEDIAN if prefix and figure == "mean" else "")
                item = f"Table I: {name}, {figure}, {kind}"
                ours = by_name[solver][f"{prefix}{figure}_us"]
                theirs = paper.get(f"{figure}_us")
                found.append(measured(item, theirs, ours, why, unit="us", timed=True))
    return [*found, *_ratios(by_name), *_kinematics()]


def _kinematics() -> list[Row]:
    """Times of m(q) and of its Jacobian, section V-B."""
    why = f"{_JULIA}; one call of Pinocchio, in the world's frame, the least mean of 5 times 100"
    return [
        measured(f"Time of {name}", paper, ours, why, unit="us", timed=True)
        for (name, ours), paper in zip(oracle.times_us().items(), (160.95, 109.85), strict=True)
    ]


def draw(timed: Sequence[dict[str, Any]]) -> Figure:
    """Table I as a picture: least, mean and greatest time of each solver."""
    by_name = {row["solver"]: row for row in timed}
    places = np.arange(len(SOLVERS), dtype=np.float64)
    curves = []
    for figure, marker in zip(FIGURES, ("v", "o", "^"), strict=True):
        for (kind, prefix), colour in zip(KINDS.items(), COLOURS, strict=False):
            times = np.array([by_name[solver][f"{prefix}{figure}_us"] for solver in SOLVERS])
            where = places + (0.12 if prefix else 0.24)
            curves.append(Curve(f"{figure}, {kind}", where, times, colour, dash="", marker=marker))
        known = [solver for solver in SOLVERS if solver in PAPERS_NAMES]
        theirs = np.array([PAPER_US[PAPERS_NAMES[solver]][f"{figure}_us"] for solver in known])
        where = np.array([places[list(SOLVERS).index(solver)] for solver in known]) - 0.12
        curves.append(Curve(f"{figure}, the paper", where, theirs, INK, dash="", marker=marker))
    kinds = ("the paper", *KINDS)
    curves.sort(key=lambda curve: kinds.index(curve.label.partition(", ")[2]))
    panel = Panel(
        "",
        "Times belong to their machines: compare solvers, not ours with the paper's",
        Axis("solver", "", (-0.5, len(SOLVERS) - 0.5)),
        Axis("time_us", "time of one solve [µs]", log=True),
        tuple(curves),
        categories=tuple(SOLVERS.values()),
    )
    return Figure("table1", "Table I: time of one solve, n = 21, γ = 0.5", ((panel,),), (9.0, 4.5))


def _ratios(by_name: dict[str, dict[str, Any]]) -> list[Row]:
    def ratio(solver: str) -> float:
        ours: float = by_name[solver]["batch_mean_us"] / by_name["qp12"]["batch_mean_us"]
        return ours

    claim = "The paper's claim is the order. How much faster QP12 is depends on the machine"
    return [
        *(
            bounded(f"Table I: {SOLVERS[solver]} / QP12, mean", "slower", ratio(solver),
                    (1.0, None), claim)
            for solver in ("pinv_svd", "osqp")
        ),
        measured(
            "Table I: PINV by Cholesky / QP12, mean",
            None,
            ratio("pinv"),
            "The paper's PINV takes an SVD; by a 3 × 3 Cholesky it costs about what QP12 does: the "
            "merit of QP12 is sparsity and a bound on the speed, not time",
        ),
    ]  # fmt: skip
