"""What the QP12 paper's equations give, computed without the controllers.

The motions of section V in plain numpy and Pinocchio: each step of 1 ms has e = m(q) − m_d and its
Jacobian in the foot's frame, (39), (16) with (41), the adaptive γ of section V-C, u by Proposition
6, and q + uT. No limit, filter or kernel of this code is used. Then formulas and distances that
other rows are compared with.
"""

from __future__ import annotations

import math
import timeit
from functools import cache, partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model, collision_shapes
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.papers.qp12.experiments import (
    BETA,
    FRAME,
    PERIOD_S,
    ROBOT,
    SECONDS,
    TARGET_M,
    U_MAX,
    Motion,
    Trials,
)
from hoap3.tools.reproduce.papers.qp12.reference import CASES, LAWS, Ellipse, Law

Array = NDArray[np.float64]


def centre_of_mass(robot: RobotModel, q: Array) -> tuple[Array, Array]:
    """m(q) and its Jacobian, seen from the right sole, for joints in the order of the wire."""
    model, data = robot.model, robot.data
    ordered, foot = np.zeros(model.nq), model.getFrameId(FRAME)
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


def move(case: str, law: Law, seconds: float) -> Motion:
    """One trial."""
    return _go(seconds, CASES[case], law, 0.0)


def plain_pinv(seconds: float = 0.4) -> Motion:
    """Law u = −10 J⁺e, without Ψ."""
    return _go(seconds, CASES["A"], Law(None), 10.0)


@cache
def all_trials() -> Trials:
    """Every law in every case."""
    return {(case, law): move(case, law, SECONDS[case]) for case in CASES for law in LAWS}


def _go(seconds: float, case: dict[str, str], law: Law, gain: float) -> Motion:
    description = load(ROBOT)
    robot, q, n = build_model(description), description.initial_position.copy(), description.n
    unit = 100.0 if case.get("error_unit") == "cm" else 1.0
    share = 1.0 if case["psi_scale"] == "one" else 1.0 / math.sqrt(n)
    ticks = round(seconds / PERIOD_S)
    v, psi = np.zeros((2, ticks))
    u, com = np.zeros((ticks, n)), np.zeros((ticks, 3))
    for k in range(ticks):
        com[k], J = centre_of_mass(robot, q)
        e, J = unit * (com[k] - np.array(TARGET_M)), unit * J
        gradient, length = J.T @ e, float(np.linalg.norm(e))
        slope = float(np.linalg.norm(gradient))
        decrease = U_MAX * slope * share * 2.0 / math.pi * math.atan(BETA * length)
        if law.gamma is None:
            step = -np.linalg.pinv(J) @ e
            u[k] = gain * step if gain else decrease / length**2 * step
        else:
            far = 2.0 / math.pi * math.atan(100.0 * slope) if law.adaptive else 1.0
            u[k] = proposition_6(gradient, decrease, law.gamma * far)
        v[k], psi[k] = 0.5 * length**2 / unit**2, 0.0 if gain else decrease / unit**2
        q += PERIOD_S * u[k]
    return Motion(v, psi, u, com)


def times_us() -> dict[str, float]:
    """Times of one call each for m(q) and its Jacobian, in the world's frame [µs]."""
    robot, q = build_model(load(ROBOT)), np.array(load(ROBOT).initial_position)
    calls = {"m(q)": pin.centerOfMass, "its Jacobian": pin.jacobianCenterOfMass}
    return {
        name: 1e4 * min(timeit.repeat(partial(call, robot.model, robot.data, q), number=100))
        for name, call in calls.items()
    }


def tanh_rate(q: Array, eta: float, kappa: float) -> float:
    """Ψ = η V tanh(κ|∇V|) of section III-C.1."""
    com, J = centre_of_mass(build_model(load(ROBOT)), q)
    e = com - np.array(TARGET_M)
    return float(eta * 0.5 * (e @ e) * math.tanh(kappa * float(np.linalg.norm(J.T @ e))))


def zero_moment_points(com: Array, gravity: float = 9.81) -> Array:
    """P = c − (z/g)·c̈ of a centre of mass by tick, from its differences, (ticks − 2, 2) [m]."""
    acceleration = np.diff(com, 2, axis=0) / PERIOD_S**2
    return np.asarray(com[1:-1, :2] - com[1:-1, 2:] / gravity * acceleration[:, :2])


def reach(case: str, error: Array) -> Array:
    """R of (41) for |e| in metres."""
    unit = 100.0 if CASES[case].get("error_unit") == "cm" else 1.0
    return np.asarray(2.0 / np.pi * np.arctan(BETA * unit * error))


def share_of_gamma(case: str, motion: Motion) -> float:
    """γ/γ_far at the start, with |∇V| from Ψ by (16)."""
    unit = 100.0 if CASES[case].get("error_unit") == "cm" else 1.0
    root = 1.0 if CASES[case]["psi_scale"] == "one" else math.sqrt(motion.u.shape[1])
    slope = motion.psi[0] * root / (U_MAX * float(reach(case, motion.error[:1])[0]))
    return float(2.0 / np.pi * np.arctan(100.0 * unit**2 * slope))


def distance_from_ball(ball: dict[str, Any], link: str, positions: Array) -> tuple[Array, Array]:
    """Distance from a ball to a link, and the link's nearest point.

    Args:
        ball: as configured.
        link: its name.
        positions: of the joints, (ticks, n) [rad].

    Returns:
        (ticks,) [m], negative inside; (ticks, 3) [m], seen from the ball's centre.
    """
    import coal

    robot = load(ROBOT)
    kinematics = Kinematics(robot)
    seen, seen_from = kinematics.frame_id(link), kinematics.frame_id(ball["frame"])
    ((shape, middle, axes),) = collision_shapes(robot)[link]
    origin, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, robot.n))
    sphere, center = coal.Sphere(ball["radius_m"]), np.array(ball["center_m"])
    request = coal.DistanceRequest()
    gap, nearest = np.zeros(len(positions)), np.zeros((len(positions), 3))
    for tick, position in enumerate(positions):
        kinematics.update(position)
        kinematics.frame(seen, seen_from, origin, turn, jacobian)
        found = coal.DistanceResult()
        gap[tick] = coal.distance(
            shape,
            coal.Transform3s(turn @ axes, origin + turn @ middle),
            sphere,
            coal.Transform3s(np.eye(3), center),
            request,
            found,
        )
        nearest[tick] = found.getNearestPoint1() - center
    return gap, nearest


def unseen(ellipse: Ellipse, q: Array, path: Array) -> float:
    """Greatest 2/T²·|Δα − ∇α·J·Δq| of a motion in steps of T [m/s²]."""
    kinematics = Kinematics(load(ROBOT))
    frame = kinematics.frame_id("r_sole")
    jacobian, place, first = np.zeros((3, kinematics.n)), np.zeros(3), np.zeros((len(q) - 1, 3))
    for k, step in enumerate(np.diff(q, axis=0)):
        kinematics.update(q[k])
        kinematics.com(frame, place, jacobian)
        first[k] = jacobian @ step
    slope = (path[:-1, :2] - ellipse.center[:2]) / np.array(ellipse.radii) ** 2
    scale = math.sqrt(math.prod(ellipse.radii))
    seen = np.stack([scale * (slope * first[:, :2]).sum(axis=1), first[:, 2]], axis=1)
    missed = np.diff(ellipse.alpha(path), axis=0) - seen
    return float(2.0 / PERIOD_S**2 * np.linalg.norm(missed, axis=1).max())
