"""A free base on soles: contacts, cones of friction, and the unknowns that they leave."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration.joint_bounds import NO_BOUND
from hoap3.remote_controller.controllers.acceleration.problem import Problem
from hoap3.remote_controller.controllers.acceleration.soles.outlines import (
    GRAVITY,
    cone_of,
    drawn_in,
    on_ground,
    supported,
)
from hoap3.remote_controller.controllers.acceleration.soles.settings import WRENCH, ContactSettings
from hoap3.remote_controller.controllers.base import ACTIVE_SPEED
from hoap3.remote_controller.model.free_dynamics import BASE
from hoap3.remote_controller.solvers.contact.reduction import ContactReduction
from hoap3.remote_controller.solvers.contact.wrench_cone import wrench_units
from hoap3.remote_controller.solvers.qp.dense_qp import SOFT, Program, daqp
from hoap3.remote_controller.tasks.accelerations.free_tasks import FreeTasks

QUATERNION, OF_LENGTH_1 = slice(3, 7), 1e-3  # in State.base; of its square
NORMAL = 2  # of a wrench
SOFT_TOLERANCE = 1e-9
FIRMER = 0.01  # of efforts and weight: a violation by that counts as 1 rad/s² of a task does
UNLOADED_SHARE = 0.02  # of the weight: what a sole may press with that State says is in the air
WRENCH_SCALE = 1.0  # of the weight: such a wrench counts as 1 rad/s² in y, so y = 0 hardly moves


class FreeBase:
    """Turns tasks, limits and cones of a robot on its soles into a `Problem` of n unknowns.

    Soles that are in the air are asked to rest all the same, but may press with 2 % of the weight
    only: so they come down again, and nothing relies on them. Without any there is no problem.

    Where `within_support` is set, tasks of the centre of mass ask for no more than the soles give
    while the angular momentum rests, see `outlines.supported`.

    Args:
        robot: its description.
        settings: of the contacts.
        tasks: of the robot.
        torque_max, greatest: torques, and accelerations that violations are relative to, (n,).

    Attributes:
        problem: what solvers are given.
        motion: v̇ of the last answer, base and joints, (n + 6,).
        wrench: what the soles take from the ground, in their axes, (6s,) [N, N m].
        residual: how far the last answer is from the equations of motion and contact, relative.
        cone_margin: the least distance of the wrenches from their cones, relative to the weight.
        decided: how many numbers `write` writes.
        conditions, present: names of what may hold, and bits of what does.

    Raises:
        ConfigError: the robot publishes no base, or has no soles; the margin leaves nothing.
    """

    def __init__(
        self,
        robot: RobotDescription,
        settings: ContactSettings,
        tasks: FreeTasks,
        torque_max: FloatArray,
        greatest: FloatArray,
    ) -> None:
        n, soles = robot.n, robot.soles
        self._settings, self._tasks, self._period = settings, tasks, robot.period_s
        self._torque_max, self._greatest = torque_max, greatest
        self._weight = tasks.dynamics.total_mass * GRAVITY
        self._outlines = [drawn_in(sole.polygon, settings.margin_m) for sole in soles]
        edges_of = [cone_of(outline, settings.friction) for outline in self._outlines]
        units = np.concatenate([wrench_units(outline) for outline in self._outlines])
        self._reduction = ContactReduction(n, units * WRENCH_SCALE * self._weight)
        s, count = len(soles), sum(map(len, edges_of))
        self._cones = np.zeros((count, WRENCH * s))
        taken = 0
        for i, edges in enumerate(edges_of):
            at = slice(taken, taken + len(edges))
            self._cones[at, WRENCH * i : WRENCH * (i + 1)] = edges
            taken += len(edges)
        self._normals = np.arange(s) * WRENCH + NORMAL
        rows = 2 * n + count + s
        self._accelerations, self._torques = slice(n), slice(n, 2 * n)
        self._of_cones, self._of_normals = slice(2 * n, 2 * n + count), slice(rows - s, rows)
        m = sum(tasks.sizes)
        stacked, wanted = np.zeros((m + n, n)), np.zeros(m + n)
        self.problem = Problem(
            stacked[:m],
            wanted[:m],
            (stacked, wanted),
            np.zeros(n),
            np.eye(n),
            np.zeros(n),
            np.full(n, -NO_BOUND),
            np.full(n, NO_BOUND),
            np.zeros((rows, n)),
            np.full(rows, -np.inf),
            np.zeros(rows),
        )
        self._soft = Program.unbounded(n, rows)
        self._soft.sense[n:] = SOFT
        self._soften = daqp(self._soft, soft=True)
        self._scale = np.ones(rows)
        self._scale[self._accelerations], self._scale[self._torques] = greatest, torque_max
        self._scale[2 * n :] = self._weight
        self._scale[n:] *= FIRMER
        self.motion, self.wrench = np.zeros(n + BASE), np.zeros(WRENCH * s)
        self._wanted = np.zeros(WRENCH * s)
        self._unloaded_for, self.loaded = np.zeros(s), np.ones(s, np.bool_)
        self.residual = self.cone_margin = math.inf
        self.decided = BASE + 2 * n + WRENCH * s
        names = [sole.frame for sole in soles]
        self.conditions = (
            *(f"{name} carries nothing" for name in names),
            "no sole carries the robot",
            "soles hold each other",
        )
        self.present = 0

    def reset(self) -> None:
        """All soles stand."""
        self._unloaded_for[:], self.loaded[:], self.present = 0.0, True, 0

    def knows(self, state: State) -> bool:
        """Whether a State says where the base is: finite, with a quaternion of length 1."""
        turn = state.base[QUATERNION]
        told = np.isfinite(state.base).all() and np.isfinite(state.contact).all()
        return bool(told and abs(float(turn @ turn) - 1.0) <= OF_LENGTH_1)

    def update(self, lower: FloatArray, upper: FloatArray, contact: FloatArray) -> bool:
        """Take a State, after the tasks have; whether there is a problem.

        Args:
            lower, upper: of the joints' accelerations, (n,) [rad/s² or m/s²].
            contact: State.contact, (6s,) of the soles in the description's order, or empty, where
                all are taken to stand.
        """
        tasks, reduction, problem = self._tasks, self._reduction, self.problem
        dynamics = tasks.dynamics
        self._feel(contact)
        if not self.loaded.any():
            return False
        rows = tasks.sole_rows
        np.multiply(dynamics.twist[rows], -self._settings.damping_per_s, out=self._wanted)
        np.subtract(self._wanted, dynamics.drift[rows], out=self._wanted)
        if not reduction.update(dynamics.mass, dynamics.bias, tasks.soles, self._wanted):
            self.present |= 2 << len(self.loaded)
            return False
        for i in tasks.coms if self._settings.within_support else ():
            self._keep_within_support(tasks.rows[i])
        jacobian, wanted = tasks.with_rest
        np.matmul(jacobian, reduction.motion, out=problem.with_rest[0])
        np.subtract(wanted, jacobian @ reduction.motion_start, out=problem.with_rest[1])
        braking, m = reduction.motion[BASE:], len(problem.wanted)
        np.matmul(braking.T, problem.with_rest[1][m:], out=problem.towards)
        self._limit(lower, upper)
        return True

    def answer(self, y: FloatArray, ddq_out: FloatArray, tau_out: FloatArray) -> None:
        """Write accelerations and torques of the joints, (n,); find `motion` and `wrench`."""
        reduction, tasks, dynamics = self._reduction, self._tasks, self._tasks.dynamics
        self.motion[:] = reduction.motion_start + reduction.motion @ y
        self.wrench[:] = reduction.wrench_start + reduction.wrench @ y
        tau_out[:] = reduction.torque_start + reduction.torque @ y
        ddq_out[:] = self.motion[BASE:]
        force = dynamics.mass @ self.motion + dynamics.bias - tasks.soles.T @ self.wrench
        force[BASE:] -= tau_out
        slip = tasks.soles @ self.motion - self._wanted
        size = 1.0 + np.abs(self.motion).max()
        self.residual = float(max(np.abs(force).max() / self._weight, np.abs(slip).max() / size))
        self.cone_margin = float(-(self._cones @ self.wrench).max() / self._weight)

    def let_joints_go(self) -> None:
        """Take the bounds of the joints' accelerations out of the problem."""
        at, problem = self._accelerations, self.problem
        problem.rows_lower[at], problem.rows_upper[at] = -np.inf, np.inf

    def soften(self, ddq_out: FloatArray, tau_out: FloatArray) -> bool:
        """The same of the y that violates its limits least, torques cut; whether one was found.

        Violations count in squares, relative to the greatest accelerations, and to 1 % of the
        greatest torques and of the weight: the ground gives no more than it can, but a joint may
        brake harder. Beside them count the tasks, all alike.
        """
        soft, problem, n = self._soft, self.problem, len(ddq_out)
        J, b = problem.with_rest
        soft.H[:] = J.T @ J + 1e-4 * np.eye(n)
        soft.f[:] = -(J.T @ b)
        soft.A[:] = problem.rows / self._scale[:, None]
        soft.least[n:] = np.maximum(problem.rows_lower / self._scale, -NO_BOUND)
        soft.most[n:] = np.minimum(problem.rows_upper / self._scale, NO_BOUND)
        solved, y, _ = self._soften(SOFT_TOLERANCE)
        if not solved or not math.isfinite(float(y.sum())):
            return False
        self.answer(y, ddq_out, tau_out)
        np.clip(tau_out, -self._torque_max, self._torque_max, out=tau_out)
        return True

    def brake(self, dq: FloatArray, rate: float, ddq_out: FloatArray, tau_out: FloatArray) -> None:
        """Torques −rate·M_jj·dq_j within the limits: what is left where nothing carries."""
        own = self._tasks.dynamics.mass.diagonal()[BASE:]
        np.clip(-rate * own * dq, -self._torque_max, self._torque_max, out=tau_out)
        np.divide(tau_out, own, out=ddq_out)
        self.motion[:BASE], self.motion[BASE:] = 0.0, ddq_out
        self.wrench[:] = 0.0
        self.residual, self.cone_margin = math.inf, 0.0

    @property
    def velocity(self) -> FloatArray:
        """v, base and joints, (n + 6,)."""
        return self._tasks.dynamics.velocity

    def write(self, tau: FloatArray, out: FloatArray) -> None:
        """Write v̇ (n + 6,), τ (n,) and w (6s,) behind each other."""
        n = len(tau)
        out[: BASE + n], out[BASE + n : BASE + 2 * n] = self.motion, tau
        out[BASE + 2 * n :] = self.wrench

    def moving(self, period_s: float) -> int:
        """How many joints move at the end of a period."""
        speed = self.velocity[BASE:] + period_s * self.motion[BASE:]
        return int((np.abs(speed) >= ACTIVE_SPEED).sum())

    def is_sound(self, tolerance: float) -> bool:
        """Whether the answer keeps its equations and cones, and every sole carries."""
        kept = self.residual <= tolerance and self.cone_margin >= -tolerance
        return bool(kept and not self.present)

    def _feel(self, contact: FloatArray) -> None:
        """Find which soles carry."""
        if contact.size:
            light = contact[self._normals] < self._settings.loaded_share * self._weight
            self._unloaded_for[~light] = 0.0
            self._unloaded_for[light] += self._period
            np.less_equal(self._unloaded_for, self._settings.lost_after_s, out=self.loaded)
        s = len(self.loaded)
        self.present = sum(1 << i for i in range(s) if not self.loaded[i])
        if not self.loaded.any():
            self.present |= 1 << s

    def _limit(self, lower: FloatArray, upper: FloatArray) -> None:
        """Write the rows of y."""
        reduction, problem = self._reduction, self.problem
        G, least, most = problem.rows, problem.rows_lower, problem.rows_upper
        at, start = self._accelerations, reduction.motion_start[BASE:]
        G[at], least[at], most[at] = reduction.motion[BASE:], lower - start, upper - start
        at, start = self._torques, reduction.torque_start
        G[at] = reduction.torque
        least[at], most[at] = -self._torque_max - start, self._torque_max - start
        at = self._of_cones
        np.matmul(self._cones, reduction.wrench, out=G[at])
        most[at] = -(self._cones @ reduction.wrench_start)
        at, start = self._of_normals, reduction.wrench_start[self._normals]
        G[at] = reduction.wrench[self._normals]
        least[at] = np.where(self.loaded, self._settings.least_share * self._weight, 0.0) - start
        most[at] = np.where(self.loaded, np.inf, UNLOADED_SHARE * self._weight) - start

    def _keep_within_support(self, rows: slice) -> None:
        """Have a task of the centre of mass ask for what the ground can give."""
        tasks, dynamics, carry = self._tasks, self._tasks.dynamics, self.loaded
        height = float(dynamics.com[2] - tasks.sole_origins[carry, 2].mean())
        placed = zip(self._outlines, tasks.sole_axes, tasks.sole_origins, strict=True)
        soles = [on_ground(*each) for each, down in zip(placed, carry, strict=True) if down]
        drift, wanted = dynamics.drift[rows], tasks.wanted[rows]
        given = supported(wanted + drift, dynamics.com, height, np.concatenate(soles))
        np.subtract(given, drift[:2], out=wanted[:2])
