"""How fast a loop around position servos may be; docs/plants.md has the proof."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray

CLOSE = 1e-3  # relative: how near the limit comes to that of the proof, from below
NEARLY = 1e-3  # of its size: real part of a root that is looked at as if it were imaginary


def rate_limit(mass: FloatArray, kp: FloatArray, kv: FloatArray) -> float:
    """A rate below which every loop u = −B·(q − q_d), B symmetric, λ(B) ≥ 0, is stable [1/s].

    The loop is M·q̈ + K_v·q̇ + K_p·q = K_p·q*, q̇* = u. For K_p alike in all joints the limit is
    1/λ_max(K_v^(−1/2)·M·K_v^(−1/2)), by Routh's criterion; otherwise, for any η ≥ 0,

        1 / sup over ω of λ_max(He R(iω)),    R(s) = (M·s² + K_v·s + K_p)⁻¹·(M·s + K_v − η·K_p)

    with He R = (R + R*)/2. The greater limit for η the least and the greatest kv/kp is taken.

    Args:
        mass: M, (n, n), symmetric [kg m², or as the joints have it].
        kp: of each joint, (n,), above 0 [N m/rad or N/m].
        kv: the same of their damping [N m s/rad or N s/m].
    """
    if kp.min() == kp.max():
        damped = np.sqrt(kv)
        return 1.0 / float(np.linalg.eigvalsh(mass / np.outer(damped, damped))[-1])
    ratios = kv / kp
    return max(1.0 / _greatest(mass, kp, kv, eta) for eta in {ratios.min(), ratios.max()})


def _greatest(mass: FloatArray, kp: FloatArray, kv: FloatArray, eta: float) -> float:
    """Sup over ω of λ_max(He R(iω)), from above.

    2g·1 − R(s) − R(−s)ᵀ is singular where λ_max reaches g, and then iω is an eigenvalue of a
    matrix: where there is none, g is above all; else the greatest value between two of them is a
    better g (after Bruinsma and Steinbuch, Systems & Control Letters 14, 1990).
    """
    n = len(kp)
    inverse, one = np.linalg.inv(mass), np.eye(n)
    A = np.block([[np.zeros((n, n)), one], [-inverse * kp, -inverse * kv]])
    B, C = np.vstack([one, -eta * inverse * kp]), np.hstack([one, np.zeros((n, n))])

    def largest(omegas: FloatArray) -> float:
        s = 1j * omegas[:, None, None]
        R = np.linalg.solve(s * s * mass + s * np.diag(kv) + np.diag(kp),
                            s * mass + np.diag(kv - eta * kp))  # fmt: skip
        return float(np.linalg.eigvalsh(0.5 * (R + R.conj().swapaxes(1, 2)))[:, -1].max())

    found = largest(np.append(0.0, np.abs(np.linalg.eigvals(A))))
    while True:
        g = (1.0 + CLOSE) * found
        crossing = np.block([[A, np.zeros_like(A)], [np.zeros_like(A), -A.T]])
        crossing += np.vstack([B, -C.T]) @ np.hstack([C, B.T]) / (2.0 * g)
        roots = np.linalg.eigvals(crossing)
        omegas = np.sort(np.abs(roots.imag[np.abs(roots.real) <= NEARLY * np.abs(roots)]))
        found = largest(np.concatenate([[0.0], omegas, 0.5 * (omegas[1:] + omegas[:-1])]))
        if found <= g:
            return g
