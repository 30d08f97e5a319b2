"""Compiled: the tangent of a curve, and the velocity that circulates it (QP12, 22 and 23)."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel


@inlined
def orthonormal_rows(gradients: FloatArray, rows: FloatArray, factor: FloatArray) -> float:
    """Factor g = L·Q by Gram and Schmidt, each row projected twice; `rows` has room for one more.

    Returns:
        How independent the rows of g are: the least sine of a row's angle to those before, times
        its length where that is below 1. 0: not at all, and Q is not complete.
    """
    k, m = gradients.shape
    least = 1.0
    for i in range(k):
        length = 0.0
        for c in range(m):
            length += gradients[i, c] * gradients[i, c]
        length = math.sqrt(length)
        if not 0.0 < length < math.inf:
            return 0.0
        for c in range(m):
            rows[i, c] = gradients[i, c]
        for j in range(i):
            factor[i, j] = 0.0
        for _ in range(2):
            for j in range(i):
                overlap = 0.0
                for c in range(m):
                    overlap += rows[i, c] * rows[j, c]
                factor[i, j] += overlap
                for c in range(m):
                    rows[i, c] -= overlap * rows[j, c]
        rest = 0.0
        for c in range(m):
            rest += rows[i, c] * rows[i, c]
        rest = math.sqrt(rest)
        least = min(least, rest / length * min(1.0, length))
        if not rest > 1e-12 * length:
            return 0.0
        factor[i, i] = rest
        for c in range(m):
            rows[i, c] /= rest
    return least


@inlined
def complete(rows: FloatArray) -> None:
    """Write into the last row the unit vector that is orthogonal to all others."""
    m = rows.shape[1]
    best, longest = 0, -1.0
    for c in range(m):
        rest = 1.0
        for i in range(m - 1):
            rest -= rows[i, c] * rows[i, c]
        if rest > longest:
            best, longest = c, rest
    for c in range(m):
        rows[m - 1, c] = 1.0 if c == best else 0.0
    for _ in range(2):
        for i in range(m - 1):
            overlap = 0.0
            for c in range(m):
                overlap += rows[m - 1, c] * rows[i, c]
            for c in range(m):
                rows[m - 1, c] -= overlap * rows[i, c]
        length = 0.0
        for c in range(m):
            length += rows[m - 1, c] * rows[m - 1, c]
        length = math.sqrt(length)
        for c in range(m):
            rows[m - 1, c] /= length


@inlined
def orientation(rows: FloatArray, work: FloatArray) -> float:
    """Sign of the determinant of an orthogonal matrix, by elimination in `work`."""
    m = rows.shape[0]
    for i in range(m):
        for c in range(m):
            work[i, c] = rows[i, c]
    sign = 1.0
    for p in range(m):
        pivot = p
        for i in range(p + 1, m):
            if abs(work[i, p]) > abs(work[pivot, p]):
                pivot = i
        if pivot != p:
            sign = -sign
            for c in range(p, m):
                work[p, c], work[pivot, c] = work[pivot, c], work[p, c]
        if work[p, p] < 0.0:
            sign = -sign
        for i in range(p + 1, m):
            share = work[i, p] / work[p, p]
            for c in range(p, m):
                work[i, c] -= share * work[p, c]
    return sign


@kernel("UniTuple(f8, 2)(f8[:,::1], f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def curve_tangent(
    gradients: FloatArray,
    direction: float,
    last: FloatArray,
    rows: FloatArray,
    factor: FloatArray,
    work: FloatArray,
    tangent_out: FloatArray,
) -> tuple[float, float]:
    """Find the unit tangent of a curve (22).

    Without a last tangent its sign is such that the determinant of the gradients and the tangent,
    in this order, has the sign of `direction`. That is continuous for as long as the gradients are;
    next to a last tangent, it is the sign of a turn below 90°, whatever becomes of the gradients'
    signs.

    Args:
        gradients: ∂α/∂x, (m − 1, m).
        direction: 1 forwards, −1 backwards.
        last: (m,) the tangent before, 0 where there is none.
        rows, factor, work: (m, m) scratch; the first two keep Q and L of g = L·Q.
        tangent_out: T, (m,); unchanged where the gradients are dependent.

    Returns:
        Independence of the gradients, 0 … 1, and cosine of the turn since `last`, 1 where there
        is none.
    """
    m = tangent_out.size
    independence = orthonormal_rows(gradients, rows, factor)
    if not independence > 0.0:
        return 0.0, 1.0
    complete(rows)
    cosine, known = 0.0, False
    for c in range(m):
        cosine += rows[m - 1, c] * last[c]
        known = known or last[c] != 0.0
    if known:
        sign = 1.0 if cosine >= 0.0 else -1.0
    else:
        sign = direction * orientation(rows, work)
        cosine = 1.0
    for c in range(m):
        tangent_out[c] = sign * rows[m - 1, c]
    return independence, abs(cosine)


@kernel("b1(f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8, f8, f8[::1], f8[::1])")
def curve_velocity(
    alpha: FloatArray,
    weights: FloatArray,
    rows: FloatArray,
    factor: FloatArray,
    tangent: FloatArray,
    speed: float,
    decrease: float,
    work: FloatArray,
    out: FloatArray,
) -> bool:
    """Solve (23) in x, with φ(y) = ½ Σ w_i·y_i²: ẋ = ζT + g⁺y.

    y = dα/dt is the least in φ with αᵀy = −decrease, for V = ½|α|²; T is orthogonal to the rows
    of g, so both constraints hold.

    Args:
        alpha, weights: α and w, (m − 1,).
        rows, factor: Q and L of g = L·Q, as `curve_tangent` left them.
        tangent, speed: T, (m,), and ζ.
        decrease: ρΨ ≥ 0.
        work: (m,) scratch.
        out: ẋ, (m,).

    Returns:
        Whether there is a solution: V = 0 cannot decrease. Else `out` is ζT.
    """
    k, m = alpha.size, tangent.size
    for c in range(m):
        out[c] = speed * tangent[c]
    if decrease == 0.0:
        return True
    largest = 0.0
    for i in range(k):
        largest = max(largest, abs(alpha[i]))
    if largest == 0.0:
        return False
    square = 0.0
    for i in range(k):
        square += (alpha[i] / largest) ** 2 / weights[i]
    for i in range(k):
        rest = -decrease / largest * (alpha[i] / largest) / weights[i] / square
        for j in range(i):
            rest -= factor[i, j] * work[j]
        work[i] = rest / factor[i, i]
        for c in range(m):
            out[c] += work[i] * rows[i, c]
    return True
