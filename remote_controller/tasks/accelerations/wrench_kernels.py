"""Compiled: a wrench kept in place of a position (Liu, Tan and Padois 2015, (3), corrected).

S (k, m) has the kept directions as its rows, which are orthonormal: m is 3 for a task of a frame's
origin, 6 where its orientation is in the task, too. All is seen in the root's axes.
"""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.triple_kernels import Triple, cross
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, dot, solve_lower
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise
from hoap3.remote_controller.tasks.se3_kernels import ANTIPODE, logarithm

DEPENDENT = 1e-12  # of |row|²: what is left of it is rounding


@inlined
def _times(rotation: FloatArray, a: Triple) -> Triple:
    """Ra."""
    return (
        rotation[0, 0] * a[0] + rotation[0, 1] * a[1] + rotation[0, 2] * a[2],
        rotation[1, 0] * a[0] + rotation[1, 1] * a[1] + rotation[1, 2] * a[2],
        rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2],
    )


@kernel("void(f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def turn_to_root(
    rotation: FloatArray, jacobian: FloatArray, twist: FloatArray, drift: FloatArray
) -> None:
    """Take the motion of a frame out of its own axes into the root's, all in place.

    With v = R·v′ and ω = R·ω′: v̇ = R·(v̇′ + ω′ × v′) and ω̇ = R·ω̇′.

    Args:
        rotation: R (3, 3) of the frame in the root.
        jacobian: J (6, n).
        twist, drift: ν and its rate at ddq = 0, (6,).
    """
    omega = (twist[3], twist[4], twist[5])
    carried = cross(omega, (twist[0], twist[1], twist[2]))
    for row in range(3):
        drift[row] += carried[row]
    for half in range(0, 6, 3):
        moved = _times(rotation, (twist[half], twist[half + 1], twist[half + 2]))
        rate = _times(rotation, (drift[half], drift[half + 1], drift[half + 2]))
        for row in range(3):
            twist[half + row], drift[half + row] = moved[row], rate[row]
        for i in range(jacobian.shape[1]):
            one = (jacobian[half, i], jacobian[half + 1, i], jacobian[half + 2, i])
            turned = _times(rotation, one)
            for row in range(3):
                jacobian[half + row, i] = turned[row]


@kernel("b1(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def rotation_error(
    rotation: FloatArray, goal: FloatArray, turn: FloatArray, error_out: FloatArray
) -> bool:
    """Write φ with exp[φ]× = R_d·Rᵀ, [rad] in the root's axes; ½|φ|² changes with −φ·ω.

    Args:
        rotation, goal: R and R_d, (3, 3).
        turn: scratch, (3, 3).
        error_out: φ (3,).

    Returns:
        Whether it is half a turn: φ is one of two opposites.
    """
    for row in range(3):
        for column in range(3):
            turn[row, column] = 0.0
            for k in range(3):
                turn[row, column] += goal[row, k] * rotation[column, k]
    x, y, z, angle, cotangent = logarithm(turn)
    error_out[0], error_out[1], error_out[2] = x, y, z
    return angle > 1.0 and cotangent < ANTIPODE


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def measure(
    rotation: FloatArray,
    wrench: FloatArray,
    sensor: FloatArray,
    origin: FloatArray,
    S: FloatArray,
    along: FloatArray,
    measured_out: FloatArray,
) -> float:
    """Write S·f, f being what the surroundings exert on the robot, about the task's origin.

    Moved from the sensor's origin s to the task's p, a torque t becomes t + (s − p) × f.

    Args:
        rotation: of the sensor in the root, (3, 3).
        wrench: of the sensor, about its origin and in its axes, (6,) [N, N m].
        sensor, origin: s and p, (3,) [m].
        S: (k, m).
        along: direction in which touching is felt, (3,); 0: any.
        measured_out: S·f, (k,) [N, N m].

    Returns:
        The force along that direction [N].
    """
    f = _times(rotation, (wrench[0], wrench[1], wrench[2]))
    t = _times(rotation, (wrench[3], wrench[4], wrench[5]))
    arm = (sensor[0] - origin[0], sensor[1] - origin[1], sensor[2] - origin[2])
    moved = cross(arm, f)
    pressed, some, square = 0.0, False, 0.0
    for k in range(3):
        pressed += along[k] * f[k]
        some = some or along[k] != 0.0
        square += f[k] * f[k]
    for r in range(S.shape[0]):
        measured_out[r] = 0.0
        for k in range(3):
            measured_out[r] += S[r, k] * f[k]
            if S.shape[1] == 6:
                measured_out[r] += S[r, 3 + k] * (t[k] + moved[k])
    return pressed if some else math.sqrt(square)


@kernel("void(f8[::1], f8[::1], f8, f8, f8[::1], b1, f8[::1], f8[::1])")
def wrench_to_aim_at(
    wanted: FloatArray,
    measured: FloatArray,
    kp: float,
    growth: float,
    most: FloatArray,
    learns: bool,
    integral: FloatArray,
    aimed_out: FloatArray,
) -> None:
    """Write w = w_d + kp·(w_d − S·f) + ki·∫(w_d − S·f), all (k,) [N, N m], at which S·f rests.

    w and w_d have the sign of f: they are what the surroundings shall exert on the robot.

    Args:
        wanted, measured: w_d and S·f.
        kp, growth: gains; the latter is ki·T, T the period.
        most: greatest size of the integral, times ki, of each direction: it stops there.
        learns: whether the integral counts on.
        integral: that, changed.
        aimed_out: w, written.
    """
    for r in range(wanted.size):
        missing = wanted[r] - measured[r]
        if learns:
            grown = integral[r] + growth * missing
            integral[r] = min(max(grown, -most[r]), most[r])
        aimed_out[r] = wanted[r] + kp * missing + integral[r]


@inlined
def _halve(
    factor: FloatArray, jacobian: FloatArray, direction: FloatArray, row: FloatArray
) -> None:
    """Write X·s = U⁻ᵀ·Jᵀ·s, (n,), of one direction s (m,)."""
    for i in range(row.size):
        row[i] = 0.0
        for k in range(direction.size):
            row[i] += direction[k] * jacobian[k, i]
    solve_lower(factor, row)


@inlined
def _take_off(row: FloatArray, units: FloatArray, count: int) -> None:
    """Leave of a row what is orthogonal to the first `count` unit rows (Gram-Schmidt, twice)."""
    for _ in range(2 if count else 0):
        for r in range(count):
            add(row, -dot(units[r], row), units[r])


@kernel(
    "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1],"
    " f8[:,::1])"
)
def inverse_task_inertia(
    mass: FloatArray,
    jacobian: FloatArray,
    S: FloatArray,
    P: FloatArray,
    factor: FloatArray,
    rows: FloatArray,
    units: FloatArray,
    scratch: FloatArray,
    inverse_out: FloatArray,
) -> None:
    """Write Λ_S⁻¹: how a wrench along S accelerates along S [1/kg, 1/(kg m), 1/(kg m²)].

    With B = J M⁻¹ Jᵀ it is S B Sᵀ − S B Pᵀ (P B Pᵀ)⁻¹ P B Sᵀ, the Schur complement: the
    directions P do not move. Where P are all others, that is (S B⁻¹ Sᵀ)⁻¹, the inverse of
    a block of [S; P] B⁻¹ [S; P]ᵀ; where there are none,
    S B Sᵀ, (3). With M = UᵀU (Cholesky) B = XᵀX of X = U⁻ᵀJᵀ, and the complement is what the
    columns of X·Pᵀ do not span of those of X·Sᵀ: nothing is inverted, and J may be of any rank.

    Args:
        mass: M (n, n).
        jacobian: J (m, n).
        S, P: (k, m) and (l, m).
        factor, rows, units, scratch: U (n, n); the columns of X·Sᵀ, as rows, less what those of
            X·Pᵀ span, (k, n); an orthonormal basis of the latter, (l, n); and scratch (n,).
        inverse_out: Λ_S⁻¹ (k, k).
    """
    n = mass.shape[0]
    for i in range(n):
        for j in range(n):
            factor[i, j] = mass[i, j]
    factorise(factor, n, 0.0, scratch)
    count = 0
    for p in range(P.shape[0]):
        unit = units[count]
        _halve(factor, jacobian, P[p], unit)
        whole = dot(unit, unit)
        _take_off(unit, units, count)
        left = dot(unit, unit)
        if left > DEPENDENT * whole:
            for i in range(n):
                unit[i] /= math.sqrt(left)
            count += 1
    for r in range(S.shape[0]):
        _halve(factor, jacobian, S[r], rows[r])
        _take_off(rows[r], units, count)
        for c in range(r + 1):
            inverse_out[r, c] = inverse_out[c, r] = dot(rows[r], rows[c])


@kernel(
    "void(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])"
)
def push(
    S: FloatArray,
    inverse_inertia: FloatArray,
    measured: FloatArray,
    aimed: FloatArray,
    kd: float,
    drift: FloatArray,
    error: FloatArray,
    motion: FloatArray,
    slope: FloatArray,
    wanted: FloatArray,
) -> None:
    """Let a task's rows ask along S for a_S = Λ_S⁻¹·(S·f − w) − kd·S·ν, and for no place there.

    a_S is what S·ν̇ shall be. With f in the equation of motion, M·ddq + h − Jᵀf = τ, it makes the
    task rest where S·f = w. Across S the rows ask for what they did; of error and motion what is
    along S is taken away. The rows of S are orthonormal, so one after the other may be replaced.

    Args:
        S: (k, m).
        inverse_inertia: Λ_S⁻¹ (k, k).
        measured, aimed: S·f and w, both on the robot, (k,) [N, N m].
        kd: [1/s].
        drift: J̇·dq, (m,).
        error, motion, slope, wanted: of the task's rows, (m,) each, changed; the last is J·ddq.
    """
    m = S.shape[1]
    for r in range(S.shape[0]):
        asking, along, moving = 0.0, 0.0, 0.0
        for c in range(S.shape[0]):
            asking += inverse_inertia[r, c] * (measured[c] - aimed[c])
        for k in range(m):
            along += S[r, k] * error[k]
            moving += S[r, k] * motion[k]
        asking -= kd * moving
        for k in range(m):
            asking -= S[r, k] * (wanted[k] + drift[k])
        for k in range(m):
            wanted[k] += asking * S[r, k]
            error[k] -= along * S[r, k]
            motion[k] -= moving * S[r, k]
    for k in range(m):
        slope[k] = -error[k]
