"""Where a target has to be sent so that what it moves comes to rest at once.

A live target goes to a point as fast as its bounds allow. Sent to where the robot is, it would
overshoot and come back. So it is sent to where the same bounds bring it to rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.tools.picture.poses import Poses
from hoap3.tools.view.picture.config_scene import Steered
from hoap3.tools.view.picture.targets import present

STEP_S = 1e-4  # of the difference that velocities of frames are taken from
NEAR = 1e-3  # m or rad: what rests so near to where it was sent stays sent there


def braking_distance(speed: float, acceleration: float, jerk: float) -> float:
    """Way to rest from a speed, ≥ 0, with bounded acceleration and jerk, from none of both.

    Down to −a and up again: v·(v/a + a/j)/2; where v < a²/j the bound a is not met: v·√(v/j).
    """
    if speed * jerk < acceleration * acceleration:
        return speed * float(np.sqrt(speed / jerk))
    return 0.5 * speed * (speed / acceleration + acceleration / jerk)


def rest_of(
    target: Steered, state: State, poses: Poses, asked: Sequence[float] | None
) -> list[float] | None:
    """Numbers of a target at which the robot's reference comes to rest from where it is.

    Those that rest where they were sent stay as they are, to the bit.

    Args:
        target: which.
        state: the newest one.
        poses: of the robot; changed.
        asked: what was asked of it last, beyond which no position goes.

    Returns:
        None where the target is none that kinematics know, such as a wrench.
    """
    rate = state.reference_rate if state.reference_rate.size else state.dq
    poses.update(state.reference, state.base)
    here = present(target, poses, state.reference)
    if here is None:
        return None
    poses.update(state.reference - STEP_S * rate, state.base)
    before = present(target, poses, state.reference - STEP_S * rate)
    if before is None:
        return None
    turns = {"frame_orientation": 0, "frame_pose": 3}.get(target.kind)
    plain = len(here) if turns is None else turns
    rates = [(a - b) / STEP_S for a, b in zip(here[:plain], before[:plain], strict=True)]
    ways = _ways(target, rates, 0)
    rest = [a + way for a, way in zip(here[:plain], ways, strict=True)]
    if asked is not None:
        ahead = [_between(r, a, b) for r, a, b in zip(rest, here, asked, strict=False)]
        rest = [b if abs(r - b) < NEAR else r for r, b in zip(ahead, asked, strict=False)]
    if turns is not None:
        now, then = np.array(here[turns:]), np.array(before[turns:])
        omega = rotation_vector(multiplied(now, conjugate(then))) / STEP_S
        turn = np.array(_ways(target, omega.tolist(), plain))
        then = multiplied(of_rotation_vector(turn), now)
        sent = then if asked is None else np.array(asked[turns:])
        away = float(np.linalg.norm(rotation_vector(multiplied(then, conjugate(sent)))))
        rest += (sent if away < NEAR else then).tolist()
    return rest


def multiplied(left: FloatArray, right: FloatArray) -> FloatArray:
    """Product of quaternions x, y, z, w."""
    v, w, u, s = left[:3], left[3], right[:3], right[3]
    return np.append(w * u + s * v + np.cross(v, u), w * s - v @ u)


def conjugate(quaternion: FloatArray) -> FloatArray:
    """The inverse of a unit quaternion x, y, z, w."""
    return np.asarray(quaternion * np.array([-1.0, -1.0, -1.0, 1.0]))


def of_rotation_vector(vector: FloatArray) -> FloatArray:
    """Unit quaternion x, y, z, w of a rotation vector, (3,) [rad]."""
    half = float(np.linalg.norm(vector)) / 2.0
    return np.append(np.sinc(half / np.pi) * vector / 2.0, np.cos(half))


def rotation_vector(quaternion: FloatArray) -> FloatArray:
    """Rotation vector, (3,) [rad], of a unit quaternion x, y, z, w; the shorter way round."""
    x = quaternion if quaternion[3] >= 0.0 else -quaternion
    sine = float(np.linalg.norm(x[:3]))
    angle = 2.0 * float(np.arctan2(sine, x[3]))
    return np.asarray(x[:3] * (angle / sine if sine > 1e-12 else 2.0))


def _ways(target: Steered, rates: Sequence[float], first: int) -> list[float]:
    """Braking distances, with their signs, of rates that are the target's from `first` on."""
    bounds = [target.told.get(key) for key in ("acceleration", "jerk")]
    ways = []
    for place, rate in enumerate(rates, first):
        limits = [float(each[place]) for each in bounds if isinstance(each, list)]
        known = len(limits) == 2 and min(limits) > 0.0
        ways.append(float(np.sign(rate)) * braking_distance(abs(rate), *limits) if known else 0.0)
    return ways


def _between(value: float, first: float, second: float) -> float:
    return min(max(value, min(first, second)), max(first, second))
