"""Compiled: inertia and accelerations of a robot of which some joints follow others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel

Indices = NDArray[np.int64]


@kernel("void(f8[:,:], i8[::1], i8[::1], f8[::1], f8[:,::1])")
def tied_inertia(
    full: FloatArray, order: Indices, mimicked: Indices, multipliers: FloatArray, out: FloatArray
) -> None:
    """Write M = Gᵀ·M_m·G, symmetric; row a of G has `multipliers[a]` at `mimicked[a]` alone.

    Args:
        full: (m, m) upper triangle of M_m, in Pinocchio's order.
        order: (m,) place there of each joint of the wire, and of each mimic joint behind them.
        mimicked: (m,) the joint of the wire that each of them moves with.
        multipliers: (m,) how far it goes for each unit of that one.
        out: (n, n) in wire order.
    """
    out[:, :] = 0.0
    for a in range(order.size):
        for b in range(order.size):
            i, j = mimicked[a], mimicked[b]
            if i > j:
                continue  # the other triangle
            p, q = order[a], order[b]
            value = full[p, q] if p <= q else full[q, p]
            out[i, j] += multipliers[a] * multipliers[b] * value
    for i in range(out.shape[0]):
        for j in range(i):
            out[i, j] = out[j, i]


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[::1])")
def accelerations(
    mass: FloatArray, added: FloatArray, torque: FloatArray, L: FloatArray, out: FloatArray
) -> None:
    """Write the solution of (M + diag(added))·out = torque, by Cholesky; NaN where M is no inertia.

    Args:
        mass: (n, n).
        added, torque, out: (n,).
        L: (n, n), overwritten.
    """
    n = torque.size
    for i in range(n):
        for j in range(i + 1):
            value = mass[i, j] + (added[i] if i == j else 0.0)
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:  # of what is no inertia there is no root
                L[i, i] = math.sqrt(value) if value > 0.0 else math.nan
            else:
                L[i, j] = value / L[j, j]
    for i in range(n):
        value = torque[i]
        for k in range(i):
            value -= L[i, k] * out[k]
        out[i] = value / L[i, i]
    for i in range(n - 1, -1, -1):
        value = out[i]
        for k in range(i + 1, n):
            value -= L[k, i] * out[k]
        out[i] = value / L[i, i]
