"""A robot with a free base on its soles: whether an answer is a motion that the ground allows.

Recomputed with a free-flyer of Pinocchio: the equations of motion, the soles' accelerations, the
torques, and that forces inside pyramids of friction at the corners of each sole add up to its
wrench. The tasks' optimum is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial import HalfspaceIntersection

from hoap3.protocol.messages import schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.hierarchy import reset_of

Array = NDArray[np.float64]

STATUS = schema("Setpoint").constants
BASE, WRENCH = 6, 6
EXACT = 1e-9  # relative: what a certified answer may be off
DEFAULTS = {
    "friction": 0.5,
    "margin_m": 0.005,
    "damping_per_s": 20.0,
    "loaded_share": 0.005,
    "lost_after_s": 0.01,
}
NORMAL = 2  # of a wrench
NOT_YET = "tasks, bounds of joints, certificate and conditions of a free base are not recomputed"
INSTEAD = "what stands in for the optimum of a free base is not recomputed"


class Ground:
    """One robot on its soles.

    Args:
        robot: its description.
        contacts: settings of the soles.
        friction: share of the joints' viscous friction that counts.
    """

    def __init__(
        self, robot: RobotDescription, contacts: Mapping[str, Any], friction: float
    ) -> None:
        self.model = pin.buildModelFromXML(robot.urdf, pin.JointModelFreeFlyer())
        names = robot.joint_names
        joints = [self.model.joints[self.model.getJointId(name)].idx_v for name in names]
        self.order = np.array([*range(BASE), *joints])
        self.model.armature[joints] = robot.armature
        if robot.gravity == "none":
            self.model.gravity.setZero()
        self.data = self.model.createData()
        self.friction = friction * np.array(self.model.damping)[joints]
        self.period, self.damping = robot.period_s, float(contacts["damping_per_s"])
        self.soles = [self.model.getFrameId(s.frame, pin.FrameType.BODY) for s in robot.soles]
        self.weight = pin.computeTotalMass(self.model) * 9.81
        self.edges = [
            _edges(np.array(sole.polygon), contacts["margin_m"], contacts["friction"])
            for sole in robot.soles
        ]
        self.sizes = [np.abs(np.array(sole.polygon)).max() for sole in robot.soles]

    def off(self, state: Any, decision: Array) -> tuple[float, float, float]:
        """How far an answer is from its equations, its soles' accelerations, and their cones.

        Relative to the weight, to the greatest acceleration, and to the weight again.
        """
        n = len(state["q"])
        motion, tau = decision[: BASE + n], decision[BASE + n : BASE + 2 * n]
        wrench = decision[BASE + 2 * n :]
        J, rate, twist, M, h = self._at(state)
        h[BASE:] += self.friction * state["dq"]
        M[BASE:, BASE:] += self.period * np.diag(self.friction)
        force = M @ motion + h - J.T @ wrench - np.concatenate([np.zeros(BASE), tau])
        slip = J @ motion + rate + self.damping * twist
        beyond = 0.0
        for i, edges in enumerate(self.edges):
            units = np.array([1.0, 1.0, 1.0, *[self.sizes[i]] * 3]) * self.weight
            felt = wrench[WRENCH * i : WRENCH * (i + 1)] / units
            beyond = max(beyond, float(nnls((edges / units * self.weight).T, felt)[1]))
        size = 1.0 + np.abs(motion).max()
        return float(np.abs(force).max() / self.weight), float(np.abs(slip).max() / size), beyond

    def _at(self, state: Any) -> tuple[Array, Array, Array, Array, Array]:
        """J, J̇·v and ν of all soles, M and h, at a State."""
        model, data, order = self.model, self.data, self.order
        base = np.array(state["base"], float)
        turn = base[3:7] / np.linalg.norm(base[3:7])
        R = pin.Quaternion(turn).matrix()
        q, v = np.zeros(model.nq), np.zeros(model.nv)
        q[:3], q[3:7], q[order[BASE:] + 1] = base[:3], turn, state["q"]
        v[:3], v[3:BASE], v[order[BASE:]] = R.T @ base[7:10], R.T @ base[10:], state["dq"]
        upper = np.triu(pin.crba(model, data, q))
        M = (upper + np.triu(upper, 1).T)[np.ix_(order, order)]
        h = np.array(pin.rnea(model, data, q, v, np.zeros(model.nv)))[order]
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        rows = [pin.getFrameJacobian(model, data, sole, pin.LOCAL)[:, order] for sole in self.soles]
        rates = [pin.getFrameAcceleration(model, data, s, pin.LOCAL).vector for s in self.soles]
        twists = [pin.getFrameVelocity(model, data, s, pin.LOCAL).vector for s in self.soles]
        return np.vstack(rows), np.concatenate(rates), np.concatenate(twists), M, h


def check_free_base(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Whether answers obey mechanics, ground and motors; the rest counts as not verified."""
    robot = run.description
    n, soles = robot.n, len(robot.soles)
    answers, states = run.answers, run.answered_states
    if (
        robot.structure.mimic_joints
        or answers["decision"].shape[1] != BASE + 2 * n + WRENCH * soles
    ):
        claims.unverified("certificate", len(answers), NOT_YET)
        return
    contacts = {**DEFAULTS, **(parameters.get("contacts") or {})}
    ground = Ground(robot, contacts, float(parameters.get("compensate_friction", True)))
    solved = (answers["fallback"] == 0) & answers.finite("decision")
    solved &= states.finite("q", "base")
    found = [
        ground.off(state, np.array(answer["decision"], float))
        for state, answer in zip(states[solved], answers[solved], strict=True)
    ]
    force, slip, beyond = np.array(found).reshape(-1, 3).T
    ticks, decision = answers["tick"][solved], answers["decision"][solved]
    tau = decision[:, BASE + n : BASE + 2 * n]
    given = (parameters.get("bounds") or {}).get("torque_max") or (math.inf,)
    most = np.minimum(robot.effort, given)
    claims.at_most("equations of motion", ticks, force, 0.0, EXACT)
    claims.at_most("soles at rest", ticks, slip, 0.0, EXACT)
    claims.at_most("friction cones", ticks, beyond, 0.0, EXACT)
    claims.at_most("torques", ticks, np.abs(tau), np.broadcast_to(most, tau.shape), EXACT * most)
    claims.equal("setpoint", ticks, answers["values"][solved], tau)
    columns = list(run.session.get("extra") or ())
    stated = answers["extra"][solved][:, columns.index("largest_torque_share")]
    claims.equal("largest torque share", ticks, stated, (np.abs(tau) / most).max(1))
    certified = answers["solver_status"] == STATUS["STATUS_CERTIFIED"]
    claims.equal("certified: solved", answers["tick"][certified], solved[certified], True, 0.0)
    if states["contact"].shape[1]:
        lost = np.any(_lost(run, contacts, ground.weight)[certified], axis=1)
        claims.equal("certified: soles carry", answers["tick"][certified], lost, False, 0.0)
    claims.unverified("certificate", len(answers), NOT_YET)
    claims.unverified("fallback", int((~solved).sum()), INSTEAD)


def _lost(run: ControllerRun, contacts: Mapping[str, Any], weight: float) -> NDArray[np.bool_]:
    """Which soles have carried too little for too long, (N, s), half a period more than that."""
    states = run.answered_states
    light = states["contact"][:, NORMAL::WRENCH] < contacts["loaded_share"] * weight
    most = contacts["lost_after_s"] / run.description.period_s + 0.5
    resets = np.array([reset_of(run, at) for at in run.answered.tolist()])
    ticks, found = np.zeros(light.shape[1]), np.zeros(light.shape, np.bool_)
    for i, now in enumerate(light):
        anew = i > 0 and resets[i] != resets[i - 1]
        ticks = np.where(now, (0.0 if anew else ticks) + 1.0, 0.0)
        found[i] = ticks > most
    return found


def _edges(polygon: Array, margin: float, friction: float) -> Array:
    """Wrenches of unit normal force along the pyramids' edges, at a sole's corners less a margin.

    Returns:
        (4k, 6), in the sole's frame.
    """
    along = np.roll(polygon, -1, axis=0) - polygon
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
    outwards /= np.linalg.norm(outwards, axis=1)[:, None]
    room = margin - np.einsum("ij,ij->i", outwards, polygon)
    halves = np.hstack([outwards, room[:, None]])
    corners = HalfspaceIntersection(halves, polygon.mean(axis=0)).intersections
    slope = friction / math.sqrt(2.0)
    found = []
    for corner in corners:
        for x, y in ((slope, slope), (slope, -slope), (-slope, slope), (-slope, -slope)):
            force = np.array([x, y, 1.0])
            found.append(np.concatenate([force, np.cross([*corner, 0.0], force)]))
    return np.array(found)
