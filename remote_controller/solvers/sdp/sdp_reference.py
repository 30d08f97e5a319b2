"""The gains of prioritised tasks in plain numpy: (21), (23), (24) and (27), and their optimum.

Marti-Saumell et al., in units of 1/β̃; `clik_reference` has L. A barrier leads near the optimum,
and Newton's method on the conditions of Karush, Kuhn and Tucker to its last digits, which no
barrier reaches: the objective is nearly flat in λ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.clik.clik_reference import stability_matrix

Array = NDArray[np.float64]


def inequality(L: Array, x: Array, dt: float) -> Array:
    """The matrix of (21), (2n, 2n), linear in x = (λ, β); its Schur complement is C(λ, β).

    Beside the diagonal it has LΛ for A = −LΛ, which changes neither that nor definiteness.
    """
    tall, n = L * x[:-1], len(L)
    root, top = np.sqrt(dt) * tall, tall + tall.T - x[-1] * np.eye(n)
    return np.block([[top, root.T], [root, np.eye(n)]])


def central_point(
    L: Array, sides: Array, ends: Array, dt: float, delta: float
) -> tuple[Array, Array, Array]:
    """x, and the multipliers Z of C and z of the limits, next to the optimum, for μ down to 10⁻¹².

    min (β − 1)² + δ|λ|² − μ log det F(x) − μ Σ log(ends − sides·λ) by damped Newton steps, which
    do not leave the interior; λ = 0 and β = −1 is inside. F(x) is `inequality`.
    """
    n, x = len(L), np.append(np.zeros(len(L)), -1.0)
    F0 = inequality(L, 0.0 * x, dt)
    F = np.array([inequality(L, unit, dt) - F0 for unit in np.eye(n + 1)])
    A, H = np.pad(sides, ((0, 0), (0, 1))), np.diag(np.append(np.full(n, 2.0 * delta), 2.0))
    for t in 100.0 ** np.arange(7):  # 1/μ
        decrement = np.inf
        while decrement > 1e-3:
            X, z = np.linalg.inv(F0 + np.tensordot(x, F, 1)), 1.0 / (ends - A @ x)
            XF = X @ F
            g = t * (H @ x) - np.trace(XF, axis1=1, axis2=2) + A.T @ z
            g[n] -= 2.0 * t
            step = np.linalg.solve(t * H + np.einsum("iab,jba", XF, XF) + (A.T * z**2) @ A, -g)
            decrement = np.sqrt(max(-g @ step, 0.0))
            x = x + step / (1.0 + decrement)
    return x, X[:n, :n] / t, z / t


def optimum(
    L: Array, S: Array, lower: Array, upper: Array, dt: float, delta: float
) -> tuple[Array, float, bool]:
    """λ and β of (27), and whether they are proved to be the optimum.

    S = B diag(e), (joints, n), of dq = S λ (23), (24); lower < 0 < upper, (joints,), or ∓inf;
    dt is Δt β̃.
    """
    sides, ends = np.vstack([S, -S]), np.concatenate([upper, -lower])
    sides, ends = sides[np.isfinite(ends)], ends[np.isfinite(ends)]
    n, (x, Z, z) = len(L), central_point(L, sides, ends, dt, delta)
    values, Q = np.linalg.eigh(Z)
    active = values > np.einsum("ik,ij,jk->k", Q, stability_matrix(L, x[:n], x[n], dt), Q)
    Y, held = Q[:, active] * np.sqrt(values[active]), z > ends - sides @ x[:n]

    def conditions(v: Array) -> Array:
        """∂/∂λ and ∂/∂β of the Lagrange function, C Y = 0 with Z = Y Yᵀ, and S λ = limit."""
        x, y, nu = np.split(v, [n + 1, n + 1 + Y.size])
        C, W = stability_matrix(L, x[:n], x[n], dt), y.reshape(Y.shape)
        w = (L - dt * x[:n, None] * (L.T @ L)).T @ W  # ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ
        slope = 2.0 * delta * x[:n] - 2.0 * (w * W).sum(1) + sides[held].T @ nu
        last = (C @ W).ravel(), sides[held] @ x[:n] - ends[held]
        return np.hstack([slope, 2.0 * (x[n] - 1.0) + (W * W).sum(), *last])

    v = np.hstack([x, Y.ravel(), z[held]])
    for _ in range(8):  # the Jacobian by complex steps; Y may be rotated, so it can be singular
        J = np.array([conditions(v + 1e-30j * unit).imag for unit in np.eye(v.size)]).T / 1e-30
        v = v - np.linalg.lstsq(J, conditions(v), rcond=1e-13)[0]
    x, nu, near = v[: n + 1], v[n + 1 + Y.size :], 1e-10 * (1.0 + np.abs(v[: n + 1]).max())
    kept = np.all(sides @ x[:n] <= ends + near) and np.all(nu >= -1e-10)
    least = np.linalg.eigvalsh(stability_matrix(L, x[:n], x[n], dt))[0]
    return x[:n], float(x[n]), bool(kept and least > -near and np.abs(conditions(v)).max() < near)
