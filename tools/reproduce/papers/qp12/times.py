"""Table I: times of QP12, PINV and OSQP. Ours are measurements; only their order has a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hoap3.tools.bench.solvers import PAPER_US
from hoap3.tools.reproduce.rows import Row, row, table

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
        found += table(
            f"Table I: {name}, ",
            *((f"{figure}, {kind}", paper.get(f"{figure}_us"),
               by_name[solver][f"{prefix}{figure}_us"], None,
               _WHY[solver] + (_MEDIAN if prefix and figure == "mean" else ""), "us")
              for kind, prefix in KINDS.items() for figure in FIGURES),
            timed=True,
        )  # fmt: skip
    ratio = {name: row["batch_mean_us"] / by_name["qp12"]["batch_mean_us"]
             for name, row in by_name.items()}  # fmt: skip
    return [
        *found,
        *(row(f"Table I: {SOLVERS[name]} / QP12, mean", "slower", ratio[name], (1.0, None), _ORDER)
          for name in ("pinv_svd", "osqp")),
        row("Table I: PINV by Cholesky / QP12, mean", None, ratio["pinv"], None, _CHOLESKY),
    ]  # fmt: skip


_ORDER = "The paper's claim is the order. How much faster QP12 is depends on the machine"
_CHOLESKY = (
    "The paper's PINV takes an SVD; by a 3 × 3 Cholesky it costs about what QP12 does: the "
    "merit of QP12 is sparsity and a bound on the speed, not time"
)
