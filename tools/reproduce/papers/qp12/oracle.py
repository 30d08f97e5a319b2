"""What the QP12 paper's equations give, computed without the controllers.

The motions of section V in plain numpy and Pinocchio: each step of 1 ms has e = m(q) − m_d and its
Jacobian in the foot's frame, (39), (16) with (41), the adaptive γ of section V-C, u by Proposition
6, and q + uT. No limit, filter or kernel of this code is used.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pinocchio as pin

from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.remote_controller.solvers.lyapunov_qp.reference import adapted_gamma, descent_rate
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.qp12 import runs


def centre_of_mass(robot: RobotModel, q: Array) -> tuple[Array, Array]:
    """m(q) and its Jacobian, seen from the right sole, for joints in the order of the wire."""
    model, data = robot.model, robot.data
    ordered, foot = np.zeros(model.nq), model.getFrameId(runs.FRAME)
    ordered[robot.order] = q
    pin.jacobianCenterOfMass(model, data, ordered)
    pin.updateFramePlacements(model, data)
    place = data.oMf[foot]
    J = pin.getFrameJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)
    share = robot.root_mass / robot.total_mass  # Pinocchio leaves the root link out
    away = (1.0 - share) * data.com[0] + share * robot.root_com - place.translation
    turning = np.cross(J[3:].T, away).T  # ω × away
    found = place.rotation.T @ ((1.0 - share) * data.Jcom - J[:3] - turning)
    return place.rotation.T @ away, found[:, robot.order]


def proposition_6(gradient: Array, decrease: float, gamma: float) -> Array:
    """U of (40): (28) to (30) in terms of the fastest joint, which does not cancel near γ = 1."""
    order = np.argsort(-np.abs(gradient), kind="stable")
    a = np.abs(gradient)[order]
    if decrease == 0.0:
        return np.zeros_like(a)
    r, d, kappa = a / a[0], (a[0] - a) / a[0], gamma / (1.0 - gamma)
    speeds = (decrease / a[0] + kappa * np.cumsum(r * d)) / np.cumsum(r * r)
    enough = np.append(r[1:] * speeds[:-1] <= kappa * d[1:], True)
    u = np.zeros_like(a)
    u[order] = np.maximum(0.0, r * speeds[enough.argmax()] - kappa * d)
    return -np.sign(gradient) * u


def move(case: str, law: runs.Law, seconds: float) -> runs.Motion:
    """One trial."""
    return _go(seconds, runs.CASES[case], law, 0.0)


def plain_pinv(seconds: float = 0.4) -> runs.Motion:
    """Law u = −10 J⁺e, without Ψ."""
    return _go(seconds, runs.CASES["A"], runs.Law(None), 10.0)


@cache
def all_trials() -> runs.Trials:
    """Every law in every case."""
    return {
        (case, law): move(case, law, runs.SECONDS[case]) for case in runs.CASES for law in runs.LAWS
    }


def unit_of(case: dict[str, str]) -> float:
    """Of e, per metre."""
    return 100.0 if case.get("error_unit") == "cm" else 1.0


def _go(seconds: float, case: dict[str, str], law: runs.Law, gain: float) -> runs.Motion:
    description = load(runs.ROBOT)
    robot, q, n = build_model(description), description.initial_position.copy(), description.n
    unit = unit_of(case)
    ticks = round(seconds / runs.PERIOD_S)
    v, psi = np.zeros((2, ticks))
    u, com = np.zeros((ticks, n)), np.zeros((ticks, 3))
    for k in range(ticks):
        com[k], J = centre_of_mass(robot, q)
        e, J = unit * (com[k] - np.array(runs.TARGET_M)), unit * J
        gradient, length = J.T @ e, float(np.linalg.norm(e))
        decrease = descent_rate(case["psi_scale"], 0.0, gradient, length, runs.U_MAX, runs.BETA)
        if law.gamma is None:
            step = -np.linalg.pinv(J) @ e
            u[k] = gain * step if gain else decrease / length**2 * step
        else:
            gamma = adapted_gamma(gradient, law.gamma) if law.adaptive else law.gamma
            u[k] = proposition_6(gradient, decrease, gamma)
        v[k], psi[k] = 0.5 * length**2 / unit**2, 0.0 if gain else decrease / unit**2
        q += runs.PERIOD_S * u[k]
    return runs.Motion(v, psi, u, com)


def reach(case: str, error: Array) -> Array:
    """R of (41) for |e| in metres."""
    unit = unit_of(runs.CASES[case])
    return np.asarray(2.0 / np.pi * np.arctan(runs.BETA * unit * error))


def share_of_gamma(case: str, motion: runs.Motion) -> float:
    """γ/γ_far at the start, with |∇V| from Ψ by (16)."""
    unit = unit_of(runs.CASES[case])
    root = 1.0 if runs.CASES[case]["psi_scale"] == "one" else math.sqrt(motion.u.shape[1])
    slope = motion.psi[0] * root / (runs.U_MAX * float(reach(case, motion.error[:1])[0]))
    return float(2.0 / np.pi * np.arctan(100.0 * unit**2 * slope))
