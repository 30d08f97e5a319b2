"""Problems of gains, and their optimum by other means: Clarabel, then Newton's method by numpy.

Nothing here uses a kernel of the solver: L and S come from pseudoinverses, the Newton steps are
least-squares solutions of the conditions of optimality, and what they arrive at is proved by its
eigenvalues and multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from ur5_dh import START, tasks

from hoap3.remote_controller.solvers.clik.clik_reference import prioritised
from hoap3.remote_controller.solvers.sdp.sdp_backends import clarabel, conic
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

    def solver(self, **options) -> SdpGains:
        solver = SdpGains(self.sizes, self.J.shape[1], weights=self.weights, **options)
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


def random(seed: int, kind: str = "") -> Problem:
    """One to four tasks, asymmetric limits, some of them far away; tasks apart where asked."""
    rng = np.random.default_rng(seed)
    sizes = tuple(int(d) for d in rng.integers(1, 4, size=rng.integers(1, 5)))
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


def optimum(it: Problem) -> tuple[np.ndarray, float, bool]:
    """λ, β, and whether they are proved to be optimal."""
    L, S = it.matrices()
    n, unit = L.shape[0], it.desired
    dt, low, high = it.dt * unit, it.lower / unit, it.upper / unit
    P, q, A, b, used, size = conic(L, S.T, np.stack([low, high]), dt, it.delta)
    x, dual = clarabel(P, q, A, b, used.size, size)
    columns, rows = np.tril_indices(size)
    Z = np.zeros((size, size))
    Z[rows, columns] = dual[used.size :] / np.where(rows == columns, 1, np.sqrt(2))
    Z = (Z + np.triu(Z, 1).T)[:n, :n]
    sides, ends = np.vstack([S, -S])[used], np.concatenate([high, -low])[used]
    for share in (1.0, 0.1, 10.0, 0.01, 100.0):
        found = _newton(L, sides, ends, dt, it.delta, x, Z, dual[: used.size], share)
        if found is not None:
            return found[0] * unit, found[1] * unit, True
    return x[:n] * unit, x[n] * unit, False


def _newton(L, sides, ends, dt, delta, x, Z, z, share):
    n, G = L.shape[0], L.T @ L
    x = x.copy()

    def matrix_of(x):
        return L * x[:n] + (L * x[:n]).T - x[n] * np.eye(n) - dt * np.outer(x[:n], x[:n]) * G

    values, vectors = np.linalg.eigh(Z)
    other = np.einsum("ik,ij,jk->k", vectors, matrix_of(x), vectors)
    Y = (vectors * np.sqrt(np.maximum(values, 0)))[:, values > share * np.maximum(other, 1e-14)]
    held = np.flatnonzero(z > share * np.maximum(ends - sides @ x[:n], 1e-14))
    a, h, nu, r = sides[held], ends[held], z[held].copy(), Y.shape[1]
    for _ in range(30):
        V, C = L - dt * x[:n, None] * G, matrix_of(x)
        w = V.T @ Y
        top = np.append(
            2 * delta * x[:n] - 2 * (w * Y).sum(1) + a.T @ nu, 2 * (x[n] - 1) + (Y * Y).sum()
        )
        F = np.concatenate([top, (C @ Y).T.ravel(), a @ x[:n] - h])
        K = np.zeros((F.size, F.size))
        K[:n, :n] = 2 * delta * np.eye(n) + 2 * dt * G * (Y @ Y.T)
        K[n, n] = 2
        for k in range(r):
            own = slice(n + 1 + k * n, n + 1 + (k + 1) * n)
            change = np.column_stack([V * Y[:, k] + np.diag(w[:, k]), -Y[:, k]])
            K[own, : n + 1], K[: n + 1, own] = change, -2 * change.T
            K[own, own] = C
        K[n + 1 + r * n :, :n], K[:n, n + 1 + r * n :] = a, a.T
        step = np.linalg.lstsq(K, -F, rcond=1e-13)[0]
        x += step[: n + 1]
        Y = Y + step[n + 1 : n + 1 + r * n].reshape(r, n).T
        nu = nu + step[n + 1 + r * n :]
        if np.abs(step[: n + 1]).max() < 1e-13 * (1 + np.abs(x).max()):
            break
    if not np.all(np.isfinite(x)):
        return None
    size = 1 + np.abs(matrix_of(x)).max()
    proved = (
        np.abs(F).max() < 1e-10 * size
        and np.linalg.eigvalsh(matrix_of(x))[0] > -1e-11 * size
        and np.all(sides @ x[:n] <= ends + 1e-11 * (1 + abs(ends)))
        and np.all(nu > -1e-10)
    )
    return (x[:n], float(x[n])) if proved else None


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
