"""What a joint can accelerate in every state, found from its torque limit by sampling.

Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control of
Robot Manipulators", IEEE RA-L 2018, Algorithm 4. Bounds of the acceleration that keep position
limits (`hoap3.protocol.limits.viability_bounds`) need an acceleration that a joint always has. A
torque limit leaves more or less of it from state to state: the worst of many random states tells
how little.

Against the paper: the two bounds differ in size, and the lower can come out above the upper, for
a joint that in some state cannot even hold its load; such joints are named. The bounds of uniform
states still fall after millions of them, because the worst ones have every velocity at its limit;
so the velocities are drawn there, which finds as much in a hundredth of the samples. As in the
paper, the other joints do not accelerate and there is no friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.limits.viability_bounds import refuse_joint
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.pinocchio_model import RobotModel
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics

Velocities = Literal["corners", "uniform"]

BATCH = 4096  # samples drawn at once
SEARCH = 300  # a search costs about so many samples a joint of the robot

SWEEPS = 400  # of that search, at most
FINEST = 1e-7  # its last step, relative to the range of a joint

_NOT_FINITE = "its torque is not finite in some states. Check its velocity limit and the masses."
_NO_INERTIA = "it moves no mass. Give what it moves an <inertial>, or the joint an armature."


@dataclass(frozen=True, eq=False)
class TorqueAccelerationBounds:
    """What the torques leave of the accelerations in the worst states that were found.

    Arrays are in wire order; rad, or m for prismatic joints.

    Attributes:
        joints: names.
        lower, upper: (n,) greatest of all least, and least of all greatest accelerations [rad/s²].
        none: names of the joints whose lower bound is not below their upper one: there is no
            acceleration that they can give in every state.
        samples: how many states were tried.
        lower_states, upper_states: (n, 2, n) by joint: q and dq of the state that gave its bound.
    """

    joints: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    none: tuple[str, ...]
    samples: int
    lower_states: FloatArray
    upper_states: FloatArray

    @property
    def either_way(self) -> FloatArray:
        """(n,) what a joint can give up as well as down; not positive where it cannot."""
        return np.minimum(-self.lower, self.upper)


def torque_acceleration_bounds(
    robot: RobotModel,
    samples: int = 1_000_000,
    *,
    velocities: Velocities = "corners",
    polish: int = 0,
    seed: int = 0,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    report: Callable[[int, int], None] | None = None,
) -> TorqueAccelerationBounds:
    """Sample Algorithm 4. The same seed gives the same states, and more samples add to them.

    Args:
        robot: of which gravity, inertias and armature are taken.
        samples: N.
        velocities: every one at its limit, forwards or backwards, or uniform in between.
        polish: from so many of the worst states of each bound, search for a worse one nearby.
        seed: of the random states.
        lower, upper, velocity, effort: limits of the position, greatest speed and torque, (n,) or
            one for all; the usable range (`sampling_range`), the velocity and the effort of the
            description.
        report: is told again and again how much is done, and of how much, in samples.

    Raises:
        BadProblemError: a joint without finite limits, a joint that moves nothing that weighs, or
            an argument outside its range.
    """
    if velocities not in get_args(Velocities):
        known = " or ".join(get_args(Velocities))
        raise BadProblemError(f"velocities cannot be {velocities!r}: write {known}.")
    for what, count, least in (("samples", samples, 1), ("polish", polish, 0), ("seed", seed, 0)):
        if isinstance(count, bool) or not isinstance(count, int) or count < least:
            raise BadProblemError(f"{what} cannot be {count!r}: write a whole number from {least}.")
    described = robot.description
    given = {"lower": lower, "upper": upper, "velocity": velocity, "effort": effort}
    usual = *described.sampling_range, described.velocity, described.effort
    limits = np.empty((4, described.n))
    for row, (name, value) in enumerate(given.items()):
        limits[row] = _row(name, usual[row] if value is None else value, described.joint_names)
    _check(limits, described.joint_names)

    n, states_of = described.n, _States(robot)
    whole = samples + 2 * n * polish * SEARCH * n
    rng = np.random.default_rng(seed)
    best = _Best(n, 1)
    starts = _Best(n, polish)
    for done in range(0, samples, BATCH):
        drawn = rng.random((BATCH, 2 * n))[: samples - done]
        bounds, states = states_of.sample(limits, drawn, corners=velocities == "corners")
        best.take(bounds, states)
        starts.take(bounds, states)
        if report is not None:
            report(min(done + BATCH, samples), whole)
    for done in _polish(states_of.polish, limits, starts, best):
        if report is not None:
            report(samples + done * SEARCH * n, whole)
    return _result(described.joint_names, best, samples)


class _States:
    """Bounds of single states, by Pinocchio."""

    def __init__(self, robot: RobotModel) -> None:
        self._dynamics = Dynamics(robot.description, robot)
        self._bias, self._inertia = np.zeros((2, robot.description.n))

    def sample(
        self, limits: FloatArray, drawn: FloatArray, *, corners: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the tightest bounds of some states, (2, n), and the states that gave them.

        Args:
            limits: (4, n) least and greatest positions, speeds and torques.
            drawn: (k, 2n) numbers from 0 to 1: what the state is of q and dq.
            corners: velocities are at their limits.

        Raises:
            BadProblemError: torques do not determine the acceleration of a joint.
        """
        least, greatest, speed, most = limits
        q, share = least + drawn[:, : len(least)] * (greatest - least), drawn[:, len(least) :]
        dq = np.where(share >= 0.5, speed, -speed) if corners else (2.0 * share - 1.0) * speed
        bias, inertia = np.empty((2, *q.shape))
        for place in range(len(q)):
            self._dynamics.bias(q[place], dq[place], bias[place])
            self._dynamics.inertia_diagonal(q[place], inertia[place])
        names = self._dynamics.robot.description.joint_names
        for problem, wrong in (
            (_NOT_FINITE, ~(np.isfinite(bias) & np.isfinite(inertia))),
            (_NO_INERTIA, ~(inertia > 0.0)),
        ):
            if wrong.any():
                joint = int(np.argwhere(wrong)[0, 1])
                raise BadProblemError(f"joint {names[joint]}: {problem}")
        lower, upper = (-most - bias) / inertia, (most - bias) / inertia
        worst = lower.argmax(axis=0), upper.argmin(axis=0)
        bounds = np.array([lower.max(axis=0), upper.min(axis=0)])
        return bounds, np.array([np.stack([q[rows], dq[rows]], axis=1) for rows in worst])

    def polish(
        self, limits: FloatArray, joint: int, upwards: bool, q: FloatArray, dq: FloatArray
    ) -> float:
        """Search the coordinates of a state in turn, and change them, for a tighter bound.

        A velocity enters by a parabola, of which the greatest value up to its limits is found; of a
        position a step to either side is tried, which is halved when nothing helps any more.

        Args:
            limits: as of `sample`.
            joint, upwards: whose bound, and which.
            q, dq: (n,) of the state, changed in place.

        Returns:
            The bound [rad/s² or m/s²].
        """
        least, greatest, speed, _ = limits
        sign, most = (1.0 if upwards else -1.0), limits[3, joint]
        dynamics, bias, inertia = self._dynamics, self._bias, self._inertia

        def tried(array: FloatArray, i: int, value: float) -> float:
            array[i] = value
            dynamics.bias(q, dq, bias)
            dynamics.inertia_diagonal(q, inertia)
            return float((sign * bias[joint] - most) / inertia[joint])

        worst, step = tried(q, 0, q[0]), 0.25  # the bound times −sign; of each position's range
        for _ in range(SWEEPS):
            before = worst
            for i in range(len(q)):
                best, ends = dq[i], [-speed[i], 0.0, speed[i]]
                down, still, up = found = [tried(dq, i, end) for end in ends]
                curved, back = down - 2.0 * still + up, 0.5 * (down - up)
                if curved < 0.0 and abs(back) < -curved:
                    ends.append(speed[i] * back / curved)
                    found.append(tried(dq, i, ends[-1]))
                if max(found) > worst:
                    worst, best = max(found), ends[int(np.argmax(found))]
                dq[i], best = best, q[i]
                far = step * (greatest[i] - least[i])
                for place in np.clip((best - far, best + far), least[i], greatest[i]):
                    here = tried(q, i, place)
                    if here > worst:
                        worst, best = here, place
                q[i] = best
            if not worst > before:
                step *= 0.5
                if step < FINEST:
                    break
        return float(-sign * worst)


class _Best:
    """The worst few states of every bound; one a batch, so that they are not all alike.

    Attributes:
        bounds: (k, 2, n) lower and upper bounds.
        states: (k, 2, n, 2, n) q and dq that gave them.
    """

    def __init__(self, n: int, size: int) -> None:
        bounds, states = _nothing(n)
        self.bounds = np.repeat(bounds[None], size, axis=0)
        self.states = np.repeat(states[None], size, axis=0)

    def take(self, bounds: FloatArray, states: FloatArray) -> None:
        """Let a batch's worst states replace what is less bad."""
        if not len(self.bounds):
            return
        mildest = np.argmin(self.bounds[:, 0], axis=0), np.argmax(self.bounds[:, 1], axis=0)
        for side, slots in enumerate(mildest):
            for joint, slot in enumerate(slots):
                kept, found = self.bounds[slot, side, joint], bounds[side, joint]
                if (found < kept) if side else (found > kept):
                    self.bounds[slot, side, joint] = found
                    self.states[slot, side, joint] = states[side, joint]


def _nothing(n: int) -> tuple[FloatArray, FloatArray]:
    """Bounds before any state is tried."""
    bounds = np.empty((2, n))
    bounds[0], bounds[1] = -math.inf, math.inf
    return bounds, np.zeros((2, n, 2, n))


def _row(name: str, value: ArrayLike, joints: Sequence[str]) -> FloatArray:
    try:
        return np.broadcast_to(np.asarray(value, np.float64), (len(joints),))
    except (TypeError, ValueError) as error:
        raise BadProblemError(
            f"{name}: give one number, or {len(joints)}, one a joint ({error})."
        ) from error


def _check(limits: FloatArray, names: Sequence[str]) -> None:
    lower, upper, velocity, effort = limits
    for side, limit in (("lower", lower), ("upper", upper)):
        problem = f"{side} limit {{0}} is not finite: nothing to draw from"
        refuse_joint(~np.isfinite(limit), names, problem, limit)
    refuse_joint(~(lower <= upper), names, "limits {0} to {1} leave no room", lower, upper)
    wrong = ~(np.isfinite(velocity) & (velocity >= 0.0))
    refuse_joint(wrong, names, "velocity {0} must be finite, and not negative", velocity)
    wrong = ~(np.isfinite(effort) & (effort > 0.0))
    refuse_joint(wrong, names, "effort {0} must be finite and positive", effort)


def _polish(
    search: Callable[..., float], limits: FloatArray, starts: _Best, best: _Best
) -> Iterator[int]:
    """Move every start to a worse state nearby; tells how many are done."""
    done = 0
    for bounds, states in zip(starts.bounds, starts.states, strict=True):
        for side, joint in np.ndindex(*bounds.shape):
            if np.isfinite(bounds[side, joint]):
                q, dq = states[side, joint]  # views, which the search moves
                bounds[side, joint] = search(limits, joint, side == 1, q, dq)
            done += 1
            yield done
        best.take(bounds, states)


def _result(joints: tuple[str, ...], best: _Best, samples: int) -> TorqueAccelerationBounds:
    """The one best of each bound."""
    (lower, upper), (lower_states, upper_states) = best.bounds[0], best.states[0]
    none = tuple(name for name, low, up in zip(joints, lower, upper, strict=True) if low >= up)
    return TorqueAccelerationBounds(joints, lower, upper, none, samples, lower_states, upper_states)
