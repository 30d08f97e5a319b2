"""Compiled: the accelerations that tasks ask for, and what becomes of their errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import dot
from hoap3.remote_controller.tasks.accelerations.se3_pd_kernels import (
    AT_HALF_A_TURN,
    Asked,
    Motion,
    Pose,
    se3_pd,
)
from hoap3.remote_controller.tasks.accelerations.wrench_kernels import rotation_error

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

POSITION, POSE, POSTURE, GIVEN, ROOT_POSE, TURN = range(6)  # kinds of tasks
PLACE, VELOCITY, ACCELERATION = 0, 1, 2  # of a target, one row each
OF_FRAMES = POSITION, POSE, ROOT_POSE, TURN
ACTIVE_SPEED = 1e-3  # rad/s or m/s: below it a joint counts as inactive
UNSURE = 1e-2  # of an acceleration, and of 1 m/s²: by how much it changes within a period


@kernel(
    "i8(i8[:,::1], f8[:,::1], f8[:,:,::1], f8[::1], f8[::1], f8[:,:,::1], f8[:,:,::1], f8[::1],"
    " i8[::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[::1])"
)
def desired_accelerations(
    tasks: Indices,
    origins: FloatArray,
    rotations: FloatArray,
    twist: FloatArray,
    drift: FloatArray,
    targets: FloatArray,
    turns: FloatArray,
    posture: FloatArray,
    joints: Indices,
    gains: FloatArray,
    q: FloatArray,
    dq: FloatArray,
    turn: FloatArray,
    error_out: FloatArray,
    motion_out: FloatArray,
    rate_out: FloatArray,
    slope_out: FloatArray,
    wanted_out: FloatArray,
) -> int:
    """Write for each row of each task its error e and what J·ddq shall be.

    A position wants a_d + kp·(x_d − x) + kd·(v_d − v) − J̇·dq, a posture kp·(q_r − q) − kd·dq, a
    pose what `se3_pd_kernels.se3_pd` says. A pose in the root's axes is a position, and below it an
    orientation that wants kp·φ − kd·ω − J̇·dq, φ of `wrench_kernels.rotation_error`, which alone
    is a turn. Of a task that is `GIVEN`, error, motion, rate and slope are written already.
    V = ½|e|² of a task changes with slope·motion, where the motion ν is that against its target,
    and ν's rate is J·ddq + rate.

    Args:
        tasks: (k, 4) by columns: kind, first row, number of rows, and which of the frames.
        origins, rotations: of the frames in the root, (f, 3) [m] and (f, 3, 3).
        twist, drift: of the rows of frames, (m,).
        targets: (k, 3, 3) x_d, v_d and a_d of positions, by `PLACE`, `VELOCITY` and
            `ACCELERATION`; the first is also the origin of a pose.
        turns: (k, 3, 3) rotation of a pose.
        posture: q_r at the rows of postures, (m,).
        joints: which joint each of these rows is, (m,).
        gains: (k, 2), by columns: kp [1/s²] and kd [1/s].
        q, dq: (n,).
        turn: scratch, (3, 3).
        error_out, motion_out, rate_out, slope_out, wanted_out: (m,).

    Returns:
        How many poses are half a turn away.
    """
    opposite = 0
    for i in range(tasks.shape[0]):
        kind, start, size, frame = tasks[i]
        kp, kd = gains[i]
        if kind == POSE:
            rows = slice(start, start + size)
            _, where = se3_pd(
                Pose(origins[frame], rotations[frame]),
                Pose(targets[i, PLACE], turns[i]),
                Motion(twist[rows], drift[rows]),
                kp,
                kd,
                turn,
                Asked(error_out[rows], wanted_out[rows], slope_out[rows]),
            )
            opposite += where == AT_HALF_A_TURN
            for row in range(start, start + size):
                motion_out[row], rate_out[row] = twist[row], drift[row]
            continue
        if kind == ROOT_POSE:
            turned = error_out[start + 3 : start + 6]
            opposite += rotation_error(rotations[frame], turns[i], turn, turned)
        if kind == TURN:
            turned = error_out[start : start + 3]
            opposite += rotation_error(rotations[frame], turns[i], turn, turned)
        for place in range(size):
            row = start + place
            if kind == GIVEN:
                error, motion, rate = error_out[row], motion_out[row], rate_out[row]
                wanted_out[row] = kp * error - kd * motion - rate
                continue
            if kind == POSTURE:
                joint = joints[row]
                error, motion, rate = posture[row] - q[joint], dq[joint], 0.0
            elif place >= 3 or kind == TURN:
                error, motion, rate = error_out[row], twist[row], drift[row]
            else:
                error = targets[i, PLACE, place] - origins[frame, place]
                motion = twist[row] - targets[i, VELOCITY, place]
                rate = drift[row] - targets[i, ACCELERATION, place]
            error_out[row], motion_out[row], rate_out[row] = error, motion, rate
            slope_out[row] = -error
            wanted_out[row] = kp * error - kd * motion - rate
    return opposite


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[:,::1], f8[:,::1])")
def place_in_root(
    position: FloatArray,
    velocity: FloatArray,
    next_velocity: FloatArray,
    T: float,
    origin: FloatArray,
    axes: FloatArray,
    out: FloatArray,
) -> None:
    """Write x_d, v_d and a_d in the root's axes of a target that is given in a frame.

    The frame is at rest against the root: its own motion is not in v_d and a_d.

    Args:
        position, velocity, next_velocity: in the frame, now and, the last, a period T later, (3,).
        T: [s].
        origin, axes: of the frame in the root, (3,) [m] and (3, 3).
        out: (3, 3), a row each.
    """
    for row in range(3):
        x, v, a = 0.0, 0.0, 0.0
        for k in range(3):
            x += position[k] * axes[row, k]
            v += velocity[k] * axes[row, k]
            a += (next_velocity[k] - velocity[k]) / T * axes[row, k]
        out[PLACE, row] = origin[row] + x
        out[VELOCITY, row], out[ACCELERATION, row] = v, a


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[:,::1], f8[::1])")
def add_friction_and_wrenches(
    frame_rows: FloatArray,
    wrench: FloatArray,
    damping: FloatArray,
    dq: FloatArray,
    T: float,
    torque_max: FloatArray,
    mass: FloatArray,
    bias: FloatArray,
) -> float:
    """Add friction to M and h, and take from h what a measured wrench does: h − Jᵀw.

    Viscous friction is taken at the end of the period: d·(dq + T·ddq).

    Args:
        frame_rows: J of the sensors, in their own axes, (6s, n).
        wrench: on the robot, (6s,) [N, N m].
        damping: d, (n,) [N m s/rad].
        dq: (n,).
        T: period [s].
        torque_max: greatest torques, (n,).
        mass, bias: M (n, n) and h (n,), changed.

    Returns:
        The greatest |h|/torque_max.
    """
    worst = 0.0
    for i in range(dq.size):
        mass[i, i] += T * damping[i]
        bias[i] += damping[i] * dq[i]
        for row in range(wrench.size):
            bias[i] -= frame_rows[row, i] * wrench[row]
        worst = max(worst, abs(bias[i]) / torque_max[i])
    return worst


@kernel(
    "Tuple((f8, f8, f8, i8))(i8[:,::1], b1[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1], f8, f8[::1])"
)
def predict_lyapunov(
    tasks: Indices,
    tops: Flags,
    jacobian: FloatArray,
    error: FloatArray,
    motion: FloatArray,
    rate: FloatArray,
    slope: FloatArray,
    dq: FloatArray,
    ddq: FloatArray,
    T: float,
    norms_out: FloatArray,
) -> tuple[float, float, float, int]:
    """Say what becomes of V = ½ Σ |e|² of the tasks that are `tops`.

    Args:
        tasks: as for `desired_accelerations`.
        tops: (k,).
        jacobian: (m, n), at least.
        error, motion, rate, slope: (m,), of `desired_accelerations`.
        dq, ddq: (n,).
        T: period [s].
        norms_out: |e| of every task, (k,).

    Returns:
        V; V̇ half a period on; the most that V may rise by in this period, per second, to second
        order in it, ½|ė|²·T with |ė| ≤ 2|ν|, and with what is `UNSURE`, so that nothing is said of
        errors of some µm; and how many joints then move. Of positions and postures |ė| = |ν|; of
        orientations φ̇ = Jl⁻¹ω, |Jl⁻¹| = (θ/2)/sin(θ/2) ≤ π/2; of poses 2 is no more than what was
        found by sampling, up to 3 rad and 1 m away: further off the bound need not hold.
    """
    V, expected, square, unsure, active = 0.0, 0.0, 0.0, 0.0, 0
    for i in range(tasks.shape[0]):
        _, start, size, _ = tasks[i]
        total = 0.0
        for row in range(start, start + size):
            total += error[row] * error[row]
            if tops[i]:
                change = rate[row] + dot(jacobian[row], ddq)
                moving = motion[row] + 0.5 * T * change
                expected += slope[row] * moving
                square += moving * moving
                unsure += abs(slope[row]) * T * (abs(change) + 1.0)
        norms_out[i] = math.sqrt(total)
        if tops[i]:
            V += 0.5 * total
    for i in range(ddq.size):
        active += abs(dq[i] + T * ddq[i]) >= ACTIVE_SPEED
    return V, expected, expected + 2.0 * T * square + UNSURE * unsure, active


@kernel("Tuple((f8, f8, b1))(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def distances(
    ddq: FloatArray,
    tau: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    greatest: FloatArray,
    torque_max: FloatArray,
    scratch: FloatArray,
) -> tuple[float, float, bool]:
    """How far accelerations and torques are from their bounds, (n,) all.

    Returns:
        The least distance, relative to the greatest acceleration or torque; the largest |τ|/τ_max;
        and whether a bound of an acceleration is reached.
    """
    least, share = 1.0, 0.0
    for i in range(ddq.size):
        scratch[i] = min(ddq[i] - lower[i], upper[i] - ddq[i]) / greatest[i]
        least = min(least, scratch[i])
        share = max(share, abs(tau[i]) / torque_max[i])
    return min(least, 1.0 - share), share, least <= 1e-9


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1])")
def give(given: FloatArray, less: FloatArray, ddq: FloatArray, out: FloatArray) -> bool:
    """Write the command, given − less, all (n,); whether that and ddq are finite."""
    finite = True
    for i in range(ddq.size):
        out[i] = given[i] - less[i]
        finite = finite and math.isfinite(out[i]) and math.isfinite(ddq[i])
    return finite
