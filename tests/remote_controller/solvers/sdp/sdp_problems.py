"""Problems of gains, and their optimum by `sdp_reference`: nothing here uses a kernel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from ur5_dh import START, tasks

from hoap3.remote_controller.solvers.clik.clik_reference import prioritised
from hoap3.remote_controller.solvers.sdp import sdp_reference
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains


@dataclass
class Problem:
    """One problem, by the names of `SdpGains`."""

    sizes: tuple[int, ...]
    J: np.ndarray
    e: np.ndarray
    dt: float
    desired: float
    lower: np.ndarray
    upper: np.ndarray
    delta: float = 5e-5
    weights: np.ndarray | None = None

    def solver(self, *, damping: float = 0.0, **options) -> SdpGains:
        solver = SdpGains(self.sizes, self.J.shape[1], **options)
        solver.damping = damping
        if self.weights is not None:
            solver.weights[:] = self.weights
        solver.lower[:], solver.upper[:] = self.lower, self.upper
        return solver

    def solved(self, **options) -> SdpGains:
        solver = self.solver(**options)
        solver.solve(self.J, self.e, self.dt, self.desired, self.delta)
        return solver

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """L and S."""
        weights = np.ones(self.e.size) if self.weights is None else self.weights
        B, L = prioritised(self.sizes, self.J, weights)
        return L, B * self.e


def random(seed: int, kind: str = "", sizes: tuple[int, ...] = ()) -> Problem:
    """One to four tasks, asymmetric limits, some of them far away; tasks apart where asked."""
    rng = np.random.default_rng(seed)
    sizes = sizes or tuple(int(d) for d in rng.integers(1, 4, size=rng.integers(1, 5)))
    n = sum(sizes)
    joints = n + int(rng.integers(0, 8))
    J = rng.normal(size=(n, joints))
    if kind == "decoupled":
        joints = 3 * len(sizes)
        J, start = np.zeros((n, joints)), 0
        for i, d in enumerate(sizes):
            J[start : start + d, 3 * i : 3 * i + 3] = rng.normal(size=(d, 3))
            start += d
    if kind == "dependent" and len(sizes) > 1:
        J[-1] = J[0] + 10 ** rng.uniform(-4, -1.5) * rng.normal(size=joints)
    reach = 10 ** rng.uniform(-0.5, 1)
    lower, upper = -reach * rng.uniform(0.1, 1, joints), reach * rng.uniform(0.1, 1, joints)
    if rng.random() < 0.2:
        lower[:], upper[:] = -np.inf, np.inf
    return Problem(
        sizes,
        J,
        rng.normal(size=n) * 10 ** rng.uniform(-2, 0),
        float(10 ** rng.uniform(-3, -1.3)),
        float(rng.uniform(0.5, 10)),
        lower,
        upper,
    )


def ur5(seed: int) -> Problem:
    """A state along the way of the paper's run, displaced."""
    rng = np.random.default_rng(seed)
    J, e = tasks(START + 0.3 * rng.normal(size=6))
    limit = rng.choice([2.0, 4.0, 6.0])
    whole = np.full(6, limit)
    return Problem((3, 1), J, e, 0.01, float(rng.choice([2.0, 8.0])), -whole, whole)


@cache
def _humanoid():
    from hoap3.remote_controller.model.kinematics import Kinematics
    from hoap3.robot_emulator.robots import load

    description = load("humanoid32")
    return description, Kinematics(description)


def humanoid(seed: int) -> Problem:
    """humanoid32 on its left foot: right foot, centre of mass, right hand; 12 rows, 32 joints."""
    from hoap3.protocol.robot.rigid_body_dynamics import Dynamics

    rng = np.random.default_rng(seed)
    description, _ = _humanoid()
    q = np.clip(
        description.initial_position + 0.1 * rng.normal(size=description.n),
        description.lower,
        description.upper,
    )
    J = stacked_humanoid(Dynamics, description, q)
    weights = np.repeat([1.0, 1e-2, 1e-4], (6, 3, 3)) if seed % 2 else None
    whole = np.full(description.n, 3.0)
    e = 0.1 * rng.normal(size=12)
    return Problem((6, 3, 3), J, e, 0.001, 4.0, -whole, whole, weights=weights)


def small(seed: int) -> Problem:
    """Up to three tasks of up to two rows; every third apart, every third nearly dependent."""
    rng = np.random.default_rng(seed)
    sizes = tuple(int(d) for d in rng.integers(1, 3, size=rng.integers(1, 4)))
    it = random(seed, ("", "decoupled", "dependent")[seed % 3], sizes)
    it.weights = 10.0 ** rng.uniform(-2, 0, it.e.size) if rng.random() < 0.3 else None
    return it


def optimum(it: Problem) -> tuple[np.ndarray, float, bool]:
    """λ, β, and whether they are proved to be optimal, by plain numpy."""
    (L, S), unit = it.matrices(), it.desired
    limits = it.lower / unit, it.upper / unit
    gains, beta, proved = sdp_reference.optimum(L, S, *limits, it.dt * unit, it.delta)
    return gains * unit, beta * unit, proved


def stacked_humanoid(dynamics_class, description, q):
    """Jacobians of the right sole (6), the centre of mass (3) and the right palm (3)."""
    import pinocchio

    from hoap3.protocol.robot.pinocchio_model import build_model

    robot = build_model(description)
    model, data = robot.model, robot.model.createData()
    order = np.array(robot.order)
    inner = np.zeros(model.nq)
    inner[order] = q
    pinocchio.computeJointJacobians(model, data, inner)
    pinocchio.updateFramePlacements(model, data)
    com = pinocchio.jacobianCenterOfMass(model, data, inner)
    local = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def of(frame):
        return pinocchio.getFrameJacobian(model, data, model.getFrameId(frame), local)

    return np.ascontiguousarray(np.vstack([of("r_sole"), com, of("r_palm")[:3]])[:, order])
