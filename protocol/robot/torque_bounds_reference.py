"""Bias, inertia and accelerations from torques in plain numpy: (30) and Algorithm 4.

Del Prete, IEEE RA-L 2018; `torque_bounds_kernels` is compared with it. Newton's and Euler's
equations of each link in the root's axes, summed over what a joint carries (D'Alembert); the
kernels walk the tree instead. Tables are those of `link_tables.Tree`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.link_tables import Tree

Array = NDArray[np.float64]


def bias_and_inertia(tree: Tree, q: Array, dq: Array) -> tuple[Array, Array]:
    """h(q, dq) and the diagonal of M(q), (n,) each, of M ddq + h = τ (30).

    Each link has mass m, first moment s and inertia I about its frame's origin; w, u, a are its
    angular velocity, its rate and the acceleration of the origin at ddq = 0, gravity included.
    """
    n, z = len(q), np.array([0.0, 0.0, 1.0])
    R, p, w, u, a = np.zeros((n, 3, 3)), *np.zeros((4, n, 3))
    F, N, s, I = *np.zeros((3, n, 3)), np.zeros((n, 3, 3))  # noqa: E741 - the symbol of it
    carried = np.eye(n, dtype=bool)  # [joint, link]
    root = np.eye(3), *np.zeros((3, 3)), -tree.gravity
    for i, (link, above) in enumerate(zip(tree.links, tree.parents, strict=True)):
        R0, p0, w0, u0, a0 = (R[above], p[above], w[above], u[above], a[above])
        R0, p0, w0, u0, a0 = root if above < 0 else (R0, p0, w0, u0, a0)
        E, c, d = link[:9].reshape(3, 3), np.cos(q[i]), np.sin(q[i])
        axis = R0 @ E @ z
        turns, shifts = (0.0, 1.0) if tree.prismatic[i] else (1.0, 0.0)
        R[i] = R0 @ E @ (np.eye(3) if shifts else [[c, -d, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]])
        arm = R0 @ link[9:12] + shifts * q[i] * axis
        p[i], w[i] = p0 + arm, w0 + turns * dq[i] * axis
        u[i] = u0 + turns * np.cross(w0, dq[i] * axis)
        a[i] = a0 + np.cross(u0, arm) + np.cross(w0, np.cross(w0, arm))
        a[i] += shifts * 2.0 * np.cross(w0, dq[i] * axis)
        xx, xy, xz, yy, yz, zz = link[16:22]
        I[i] = R[i] @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] @ R[i].T
        s[i] = R[i] @ link[13:16]
        F[i] = link[12] * a[i] + np.cross(u[i], s[i]) + np.cross(w[i], np.cross(w[i], s[i]))
        N[i] = I[i] @ u[i] + np.cross(w[i], I[i] @ w[i]) + np.cross(s[i], a[i])
        if above >= 0:
            carried[:, i] |= carried[:, above]
    h, M = np.zeros(n), tree.links[:, 22].copy()
    for j in range(n):
        axis = R[j] @ z
        for i in (link for link in range(n) if carried[j, link]):
            arm, m = p[i] - p[j], tree.links[i, 12]
            v, spin = (axis, 0.0 * axis) if tree.prismatic[j] else (np.cross(axis, arm), axis)
            h[j] += v @ F[i] + spin @ N[i]
            M[j] += m * v @ v + 2.0 * v @ np.cross(spin, s[i]) + spin @ I[i] @ spin
    return h, M


def possible(tree: Tree, q: Array, dq: Array, effort: Array) -> tuple[Array, Array]:
    """Least and greatest acceleration of each joint alone in a state: (∓τ_max − h)/M."""
    h, M = bias_and_inertia(tree, q, dq)
    return (-effort - h) / M, (effort - h) / M
