"""What a joint can accelerate in every state, found from its torque limit by sampling.

Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control of
Robot Manipulators", IEEE RA-L 2018, Algorithm 4. Bounds of the acceleration that keep position
limits (`hoap3.protocol.robot.viability_bounds`) need an acceleration that a joint always has. A
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
from functools import partial
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.link_tables import build_tree
from hoap3.protocol.robot.pinocchio_model import RobotModel
from hoap3.protocol.robot.viability_bounds import refuse_joint

Velocities = Literal["corners", "uniform"]

BATCH = 4096  # samples drawn at once
SEARCH = 300  # a search costs about so many samples a joint of the robot

_PROBLEMS = (  # of a state, by the status of the kernel less 1
    "its torque is not finite in some states. Check the limits of the velocities and the masses.",
    "it moves nothing that weighs. Give what it moves an <inertial>, or the joint an armature.",
)


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
    described, states_of = robot.description, _states_of(robot)
    given = {"lower": lower, "upper": upper, "velocity": velocity, "effort": effort}
    usual = *described.sampling_range, described.velocity, described.effort
    limits = np.empty((4, described.n))
    for row, (name, value) in enumerate(given.items()):
        limits[row, states_of.order] = _row(
            name, usual[row] if value is None else value, described.joint_names
        )
    names = [described.joint_names[joint] for joint in np.argsort(states_of.order)]
    _check(limits, names)

    n = described.n
    whole = samples + 2 * n * polish * SEARCH * n
    rng = np.random.default_rng(seed)
    best = _Best(n, 1)
    starts = _Best(n, polish)
    for done in range(0, samples, BATCH):
        drawn = rng.random((BATCH, 2 * n))[: samples - done]
        bounds, states = _nothing(n)
        corners = velocities == "corners"
        status, joint = states_of.sample(limits, corners, drawn, bounds, states)
        if status:
            raise BadProblemError(f"joint {names[joint]}: {_PROBLEMS[status - 1]}")
        best.take(bounds, states)
        starts.take(bounds, states)
        if report is not None:
            report(min(done + BATCH, samples), whole)
    for done in _polish(states_of.polish, limits, starts, best):
        if report is not None:
            report(samples + done * SEARCH * n, whole)
    return _result(described.joint_names, states_of.order, best, samples)


class _States(NamedTuple):
    """What tries states: `torque_bounds_kernels`, or the same by Pinocchio.

    Attributes:
        order: (n,) place of each joint of the wire in their arrays.
        sample, polish: see there.
    """

    order: NDArray[np.int64]
    sample: Callable[..., tuple[int, int]]
    polish: Callable[..., float]


def _states_of(robot: RobotModel) -> _States:
    from hoap3.protocol.robot import torque_bounds_kernels as kernels
    from hoap3.protocol.robot.followers.torque_bounds import FollowerStates

    if robot.followers is not None:
        slow = FollowerStates(robot)
        return _States(slow.order, slow.sample, slow.polish)
    tree = build_tree(robot)
    sample, polish = partial(kernels.sample, *tree.tables), partial(kernels.polish, *tree.tables)
    return _States(tree.order, sample, polish)


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


def _result(
    joints: tuple[str, ...], order: NDArray[np.int64], best: _Best, samples: int
) -> TorqueAccelerationBounds:
    """The one best of each bound, in wire order."""
    lower, upper = (np.ascontiguousarray(bound[order]) for bound in best.bounds[0])
    lower_states, upper_states = (
        np.ascontiguousarray(states[order][:, :, order]) for states in best.states[0]
    )
    none = tuple(name for name, low, up in zip(joints, lower, upper, strict=True) if low >= up)
    return TorqueAccelerationBounds(joints, lower, upper, none, samples, lower_states, upper_states)
