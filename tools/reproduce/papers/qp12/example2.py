"""Example 2: the input of least ℓp norm, from one joint to all joints alike.

For HOAP-3 at the start of the paper's experiment: a = ∇V and b = −Ψ, Ψ without 1/√n. Each answer
stands beside one that is found without the paper's formula: for p ≤ 1, where the norm is concave
in every orthant, the best of all that one joint can do; for 1 < p < ∞ a descent along pairs of
joints; for p = ∞ the least that Hölder's inequality leaves, |u|∞ ≥ |b|/|a|₁.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.solvers import DescentRate, lp_norm, pinv_plain
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.qp12.experiments import BETA, FRAME, ROBOT, TARGET_M, U_MAX
from hoap3.tools.reproduce.papers.qp12.reference import EXACT, least, norm
from hoap3.tools.reproduce.rows import Row, bounded, near

POWERS = (0.5, 1.0, 1.2, 1.5, 2.0, 4.0, math.inf)
NEAR_ONE = 1.001


@dataclass(frozen=True, eq=False)
class Answers:
    """Example 2 solved.

    Attributes:
        gradient: ∇V, (n,) [m²/rad].
        decrease: Ψ [m²/s].
        u: answers by p, each (n,) [rad/s].
    """

    gradient: Array
    decrease: float
    u: dict[float, Array]

    @property
    def moving(self) -> Array:
        """Which joints can change V at all, steepest first."""
        order = np.argsort(-np.abs(self.gradient), kind="stable")
        return np.asarray(order[self.gradient[order] != 0.0])


def solve(powers: tuple[float, ...] = POWERS) -> Answers:
    """Example 2 for HOAP-3 at its start."""
    kinematics = Kinematics(load(ROBOT))
    kinematics.update(load(ROBOT).initial_position)
    place, jacobian = np.zeros(3), np.zeros((3, kinematics.n))
    kinematics.com(kinematics.frame_id(FRAME), place, jacobian)
    error = place - np.array(TARGET_M)
    gradient = jacobian.T @ error
    distance = float(np.linalg.norm(error))
    psi = DescentRate("one", u_max=U_MAX, beta=BETA)(0.5 * distance**2, gradient, distance)
    return Answers(gradient, psi, {p: lp_norm(gradient, psi, p) for p in powers})


def rows(found: Answers) -> list[Row]:
    """Each norm beside the least, and what the paper says of both ends."""
    a, b = found.gradient, found.decrease
    steepest, made = found.moving[0], []
    for p, u in found.u.items():
        reference = least(a, b, p)
        if math.isinf(p):
            why = "Beside it the bound of Hölder's inequality, |b|/|a|₁"
        elif p <= 1.0:
            why = (
                "Beside it the best of all that one joint can do: a concave Φ is least in a corner"
            )
        else:
            why = "Beside it a descent along pairs of joints, without formula (9)"
        item = f"Example 2: |u|_p / the least there is, p = {p:g}"
        made.append(near(item, 1, norm(u, p) / reference, 1.0, why, absolute=EXACT))
    one = "As the paper: up to p = 1 only the steepest joint moves"
    for p in (p for p in found.u if p <= 1.0):
        alone = np.flatnonzero(found.u[p]).tolist() == [int(steepest)]
        item = f"Example 2: joints that move, p = {p:g}"
        moving = float(np.count_nonzero(found.u[p])) if alone else math.nan
        made.append(bounded(item, 1, moving, (1.0, 1.0), one))
    even = np.abs(found.u[math.inf][found.moving])
    item = "Example 2: (greatest − least |u_i|) / greatest, p = inf"
    alike = "As the paper: all alike"
    made.append(bounded(item, 0, float(np.ptp(even) / even.max()), (None, 1e-12), alike))
    close, limit = lp_norm(a, b, NEAR_ONE), found.u[1.0]
    item = f"Example 2: |u(p = {NEAR_ONE:g}) − u(1)| / |u(1)|"
    both = "As the paper: both sides of p = 1 agree. As printed (9) is 0/0 there in doubles"
    apart = float(np.abs(close - limit).max() / np.abs(limit).max())
    made.append(bounded(item, "0 as p falls to 1", apart, (None, 1e-3), both))
    plain = pinv_plain(a[None, :], np.array([b]), 1.0)
    item, one_row = "Example 2: |u(2) − J⁺| / |u(2)|", "p = 2 is the pseudo-inverse of the row ∇Vᵀ"
    apart = float(np.abs(found.u[2.0] - plain).max() / np.abs(plain).max())
    return [*made, bounded(item, None, apart, (None, 1e-12), one_row)]


def draw(found: Answers) -> Figure:
    """|u_i| for several p, joints in order of their slope."""
    order = found.moving
    names = load(ROBOT).joint_names
    places = np.arange(len(order), dtype=np.float64)
    curves = [
        Curve(
            "p = ∞" if math.isinf(p) else f"p = {p:g}",
            places[shown],
            np.abs(u[order])[shown],
            colour,
            dash="-" if p > 1.0 else "",
            marker=marker,
        )
        for (p, u), colour, marker in zip(found.u.items(), COLOURS, "so^vDPX", strict=True)
        for shown in [u[order] != 0.0]
    ]
    panel = Panel(
        "",
        "joints by the steepness of V along them; below 1e-4 rad/s nothing is drawn",
        Axis("joint", "", (-0.5, len(order) - 0.5)),
        Axis("u_rad_per_s", "|u| [rad/s]", (1e-4, 1.0), log=True),
        tuple(curves),
        categories=tuple(names[place] for place in order),
    )
    title = "Example 2: the input of least ℓp norm, at the start of the experiment"
    return Figure("example2", title, ((panel,),), (13.0, 4.5))
