"""What section III states without an experiment: each with a shipped config, in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers import StableQp
from hoap3.tools.reproduce.papers.qp12 import oracle
from hoap3.tools.reproduce.papers.qp12.certified import certified, config, falls, run
from hoap3.tools.reproduce.papers.qp12.experiments import com_path, joint_names, sole
from hoap3.tools.reproduce.papers.qp12.support import BEYOND_M
from hoap3.tools.reproduce.rows import Row, bounded

ETA, KAPPA = 5.0, 200.0  # 1/s, 1/|∇V|
EVERY = 50  # ticks


def rows(say: Callable[[str], None] = lambda _: None, seconds: float = 2.0) -> list[Row]:
    """All of them."""
    say(f"(18), ZMP, Pfaffian, tanh, Remark 1 and kept ρ: {seconds:g} s each")
    parts = (tracking, pfaffian, tanh, remark_1, kept_rho)
    return [row for part in parts for row in part(seconds)]


def tracking(seconds: float) -> list[Row]:
    """(18) along a target that moves, and the zero-moment point of section III-E."""
    content, item = config("com_tracking"), "(18): moving target"
    done, target = run(content, seconds), content["parameters"]["task"]["parameters"]["target"]
    margin = sole().max(axis=0) - np.abs(oracle.zero_moment_points(com_path(done.q)))
    follows = "As the paper: with the feed-forward e stays near 0; what is left is due to the steps"
    inside = "As the paper: p = c − (z/g)·c̈ from differences of the logged positions"
    least, ratio = float(margin.min()), float(done.error.max()) / target["half_width_m"]
    return [
        bounded(f"{item}, greatest |e| / half width", "follows", ratio, (None, 0.01), follows),
        *certified(item, done, -1e-6),
        bounded("III-E: ZMP, distance to the sole's edge", "inside", least, (0, None), inside),
    ]


def pfaffian(seconds: float) -> list[Row]:
    """C(q)·u = 0: both knees turn alike."""
    names, matrix = joint_names(), np.zeros(len(joint_names()))
    matrix[[names.index("r_knee"), names.index("l_knee")]] = 1.0, -1.0
    content = _stable_qp({"kind": "qp12", "gamma": 0.0})
    entry = {"constraint": "pfaffian", "parameters": {"matrix": [matrix.tolist()]}}
    content["parameters"]["constraints"].append(entry)
    done, item = run(content, seconds), "III-E: Pfaffian C u = 0"
    steps = np.diff(done.q, axis=0)
    off = float(np.abs(steps @ matrix).max() / np.abs(steps[:, matrix != 0.0]).max())
    why = "As the paper, as an equation: both knees turn alike"
    item_off = f"{item}, greatest |C u| / speed of a knee"
    return [bounded(item_off, 0, off, (None, 1e-9), why), falls(item, done)]


def tanh(seconds: float) -> list[Row]:
    """Ψ of section III-C.1."""
    content = _stable_qp({"kind": "qp12", "gamma": 0.0})
    content["parameters"]["psi"] = {"form": "tanh", "eta_per_s": ETA, "kappa": KAPPA}
    done, item = run(content, seconds), "III-C.1: Ψ with tanh"
    expected = [oracle.tanh_rate(q, ETA, KAPPA) for q in done.q[::EVERY]]
    off = float(np.abs(done.psi[::EVERY] / expected - 1.0).max())
    item_off, why = f"{item}, greatest |Ψ / ηV tanh(κ|∇V|) − 1|", "Next to it the oracle's formula"
    return [
        bounded(item_off, 0, off, (None, 1e-6), why), falls(item, done), *certified(item, done)
    ]  # fmt: skip


def remark_1(seconds: float) -> list[Row]:
    """V̇ ≤ 0 in place of V̇ = −ρΨ."""
    content = _stable_qp({"kind": "least_squares"})
    content["parameters"]["lyapunov"] = "descent"
    done, item, refused = run(content, seconds), "Remark 1: V̇ ≤ 0", 0
    try:
        StableQp(3, objective="qp12", lyapunov="descent")
    except BadProblemError:
        refused = 1
    ratio, why = float(done.error[-1] / done.error[0]), "With least squares, ½|de/dt + g·e|², as Φ"
    norms = "u = 0 is their optimum, so the robot would never move. The paper does not say so"
    return [
        falls(item, done),
        bounded(f"{item}, |e| at the end / at the start", "stable", ratio, (None, 0.5), why),
        bounded(f"{item}, norms of u as Φ that are refused", None, refused, (1, 1), norms),
    ]


def kept_rho(seconds: float) -> list[Row]:
    """End of section III-A: ρ kept while it is feasible."""
    content = config("stable_qp_hoap3")
    content["parameters"]["task"]["parameters"]["target"]["position_m"][0] = BEYOND_M
    content["parameters"] |= {"rho": "largest", "keep_rho": True}
    done, item = run(content, seconds), "III-A: ρ kept while it is feasible"
    rise, fall = float(np.diff(done.rho).max()), float(done.rho[0] - done.rho[-1])
    kept = "As the paper: ρ is computed anew only where it is no longer feasible"
    lower = "The target is out of reach, so ρ has to fall"
    return [
        bounded(f"{item}, greatest rise of ρ", 0, rise, (None, 0.0), kept),
        bounded(f"{item}, fall of ρ in all", None, fall, (1e-3, None), lower),
        *certified(item, done),
    ]


def _stable_qp(objective: dict[str, Any]) -> dict[str, Any]:
    """The config `stable_qp` without a ramp, to the paper's target."""
    content = config("stable_qp")
    content["parameters"]["psi"]["ramp_s"] = 0.0
    task = config("stable_qp_hoap3")["parameters"]["task"]
    content["parameters"] |= {"objective": objective, "task": task}
    return content
