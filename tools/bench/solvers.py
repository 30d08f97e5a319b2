"""`hoap3 bench solvers` and `bench scaling`: Table I of the QP12 paper, and beyond it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from remote_controller.solvers import Pinv
from tools.bench.peers import PEERS, Solve, peer
from tools.bench.timing import time_calls

GAMMA = 0.5
PAPER_US = {
    "qp12": {"min_us": 1.259, "mean_us": 1.358, "max_us": 7.575},
    "pinv": {"min_us": 7.713, "mean_us": 12.04, "max_us": 35.15},
    "osqp": {"min_us": 29.64, "mean_us": 32.3, "max_us": 153.24},
}
"""Table I, on the authors' machine in Julia."""

SIZES = (7, 14, 21, 32, 50, 100, 200, 500, 1000)
SLOW_ABOVE = 100  # joints, from which dense solvers are left out of a scaling run
STREAM = 512

Array = NDArray[np.float64]


def gradients(n: int, seed: int = 0) -> tuple[Array, Array]:
    """A stream of slowly varying, positive gradients, (STREAM, n), and the decrease of each.

    It runs to and fro, so that a stream that is walked through again has no jump.
    """
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(scale=0.02, size=(STREAM // 2, n)), axis=0)
    walk = np.abs(rng.normal(size=n) + steps)
    there_and_back = np.ascontiguousarray(np.vstack([walk, walk[::-1]]))
    decrease = 0.1 * np.linalg.norm(there_and_back, axis=1)
    return there_and_back, decrease


def bench_solvers(n: int = 21, samples: int = 10_000, gamma: float = GAMMA) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …} of every solver that is installed.

    Each row also says how far its answers are from ours at the most, relative to the largest
    speed, and how much slower it is than ours by its median.
    """
    stream, decrease = gradients(n)
    rows = []
    exact = peer("qp12", n, gamma)
    for name in PEERS:
        solve = peer(name, n, gamma)
        if solve is None or exact is None:
            continue
        error = max(
            _difference(exact(a, b), solve(a, b)) for a, b in zip(stream, decrease, strict=True)
        )
        row = {
            "solver": name,
            "n": n,
            **time_calls(_walk(solve, stream, decrease), samples),
        }
        row["worst_error"] = error
        rows.append(row)
    rows += [_pinv_row(n, samples), _svd_row(n, samples)]
    reference = rows[0]["p50_us"]
    for row in rows:
        row["times_qp12"] = row["p50_us"] / reference
        row["paper"] = PAPER_US.get(row["solver"]) if n == 21 else None
    return rows


def bench_scaling(samples: int = 300, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Median time of each solver over the number of joints, and the slope of its growth.

    The slope is fitted to log(time) over log(n), for 32 joints and more.
    """
    rows = []
    for name in PEERS:
        for n in sizes:
            if name not in {"qp12", "osqp"} and n > SLOW_ABOVE:
                continue
            solve = peer(name, n, GAMMA)
            if solve is None:
                continue
            stream, decrease = gradients(n)
            timed = time_calls(
                _walk(solve, stream, decrease),
                samples,
                20,
            )
            rows.append({"solver": name, "n": n, **timed})
    slopes = {}
    for name in {row["solver"] for row in rows}:
        points = [
            (row["n"], row["p50_us"]) for row in rows if row["solver"] == name and row["n"] >= 32
        ]
        if len(points) > 1:
            sizes_seen, times = np.log(np.array(points)).T
            slopes[name] = float(np.polyfit(sizes_seen, times, 1)[0])
    return {"rows": rows, "slopes": slopes}


def _walk(solve: Solve, stream: Array, decrease: Array) -> Callable[[int], Array]:
    """Call k solves problem k of the stream, over and over."""
    return lambda k: solve(stream[k % STREAM], decrease[k % STREAM])


def _difference(exact: Array, other: Array) -> float:
    """Largest difference of |x| relative to the largest speed."""
    return float(np.max(np.abs(np.abs(exact) - np.abs(other))) / np.max(np.abs(exact)))


def _pinv_row(n: int, samples: int) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    solver, jacobian, out = Pinv(3, n), rng.normal(size=(3, n)), np.zeros(n)
    errors = rng.normal(size=(STREAM, 3))
    timed = time_calls(lambda k: solver.solve(jacobian, errors[k % STREAM], 0.1, out), samples)
    return {"solver": "pinv", "n": n, **timed, "worst_error": None}


def _svd_row(n: int, samples: int) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    jacobian, errors = rng.normal(size=(3, n)), rng.normal(size=(STREAM, 3))
    timed = time_calls(lambda k: np.linalg.pinv(jacobian) @ errors[k % STREAM], samples)
    return {"solver": "pinv_svd", "n": n, **timed, "worst_error": None}
