"""What stands between accelerations or torques and the motors: bounds, loss policy, safe stop.

Not a safety function in the sense of any norm.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.errors import BadProblemError, DescriptionError
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.filters import base
from hoap3.robot_emulator.plants.base import Plant, TorqueModel

TORQUE_MARGIN = 2e-3, 0.02, 0.9
"""Of the range [rad or m], of the velocity [relative], and the share of the deceleration that
stopping in time counts on: under a torque that is held for a period the acceleration changes with
the motion, and friction with its direction."""

SOFTNESS = 1e-6  # rad or m: of the margin, on which a joint is drawn back gently

PERIODS_AHEAD = 2
"""Periods for which an acceleration that is let through could be held without harm."""

ROUNDING = 1e-12  # of a share of accelerations
REST = 1e-3  # rad/s or m/s: a braking robot that is slower than this sets its brakes

PATIENCE_S = 0.5
"""A stop that takes so much longer than planned, because efforts do not suffice, is left to the
brakes: they hold whatever the motors cannot."""


class AccelerationFilter:
    """Accelerations within the bounds that keep each joint able to stop (`viability_bounds`).

    The bounds are those for twice the period, with the description's `brake_acceleration`, on its
    usable range and velocity less a margin, and never with more than `setpoint_acceleration_max`.
    A joint that starts outside its range may not go further out, and once somebody new commands it
    not out again. What is within the bounds passes bit by bit.

    A missing setpoint is replaced by the last one, at most `hold_ticks` times in a row. Then all
    joints brake together, in a straight line, until the next one comes.

    Args:
        description: of the robot.
        plant: its body, of which `q` and `dq` are used.
        hold_ticks: see above.
        margin: of the range [rad or m], of the velocity [relative], and the share of the
            deceleration that stopping in time counts on.

    Attributes:
        value: command that is given to the plant, (n,) [rad/s² or m/s²].
        reference: where the commanded motion is, (n,) [rad or m]: where the body is.
        rate: how fast, (n,) [rad/s or m/s]: as fast as the body.
        interventions: periods in which some joint was held back.
        held_back: the first joint held back in the last period, or -1.
        overloaded: the first joint whose effort is too small for the bounds in this period, or -1.
        torque_limited: periods in which there was one.

    Raises:
        BadProblemError: limits too narrow for the accelerations, by condition (11).
    """

    def __init__(
        self,
        description: RobotDescription,
        plant: Plant,
        hold_ticks: int,
        margin: tuple[float, float, float] = (1e-10, 1e-10, 1.0),
    ) -> None:
        from hoap3.robot_emulator.plants.motion_kernels import clamp

        n = description.n
        self._clamp = clamp
        self._description, self._plant = description, plant
        self._dt = description.period_s
        self._hold_ticks, self._margin = hold_ticks, margin
        self._brake = np.minimum(
            description.brake_acceleration, description.setpoint_acceleration_max
        )
        self.reference, self.rate = plant.q, plant.dq
        self.value = np.zeros(n)
        self.interventions = self.torque_limited = 0
        self.held_back = self.overloaded = -1
        self._wanted, self._given, self._lower, self._upper, self._stop_speed = np.zeros((5, n))
        self._missed = 0
        self._have = self._braking = False
        self._stop_ticks = self._stopped_for = 0
        room = margin[0]
        self._usual = np.array([description.lower + room, description.upper - room])
        self._ends = self._usual.copy()  # of the range in use
        self._bounds = self._within_ends()

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,).

        Raises:
            DescriptionError: limits too narrow for the accelerations, by condition (11).
        """
        self._ends[0], self._ends[1] = -np.inf, np.inf
        self._begin_at(q)

    def forget(self) -> None:
        """Forget earlier setpoints: nothing is asked for but to stay."""
        self._begin_at(self._plant.q)

    def _begin_at(self, q: FloatArray) -> None:
        """End the range of a joint that was outside where it is; what is inside stays inside."""
        (lower, upper), (least, most) = self._usual, self._ends
        np.maximum(least, np.minimum(lower, q), out=least)
        np.minimum(most, np.maximum(upper, q), out=most)
        self._bounds = self._within_ends()
        self._have = self._braking = False
        self._missed = 0

    def _within_ends(self) -> AccelerationBounds:
        robot, (room, slower, share) = self._description, self._margin
        limits = *self._ends, robot.velocity * (1.0 - slower), self._brake, self._dt
        try:
            return AccelerationBounds(
                *limits,
                horizon_s=PERIODS_AHEAD * self._dt,
                brake_share=share,
                softness=SOFTNESS if room > SOFTNESS else 0.0,
                names=robot.joint_names,
            )
        except BadProblemError as error:
            problem = str(error).partition(";")[0].rstrip(".")
            raise DescriptionError(
                f"robot {robot.name!r} cannot take {robot.command_kinds[0]}: {problem}, where T is "
                f"{PERIODS_AHEAD} periods, A the lesser of brake_acceleration and "
                f"setpoint_acceleration_max, and {room:g} of the range is kept "
                "in reserve at each end. Lower brake_acceleration, widen the limits, or choose "
                "another `command`"
            ) from error

    def follow(self, setpoint: FloatArray, tick: int) -> int:
        """Take a setpoint, (n,).

        Returns:
            The number of a joint that was held back, or -1.
        """
        del tick
        self._given[:] = setpoint
        self._have, self._braking, self._missed = True, False, 0
        return self._apply(self._given)

    def hold(self) -> int:
        """No setpoint: keep to the last one for a while, then brake."""
        self._missed += 1
        if self._have and self._missed <= self._hold_ticks:
            return self._apply(self._given)
        if not self._braking:
            self.begin_stop()
            self._braking = True
        self.brake()
        return -1

    def extrapolate(self) -> int:
        """The same: a force is not a motion that goes on."""
        return self.hold()

    def begin_stop(self) -> None:
        """Plan to brake to rest: all joints together, in a straight line, at the limit of one."""
        self._stop_speed[:] = self._plant.dq
        duration = float(np.max(np.abs(self._stop_speed) / self._brake, initial=0.0))
        self._stop_ticks = max(1, math.ceil(duration / self._dt - 1e-9))
        self._stopped_for = 0

    def brake(self) -> bool:
        """One period of the planned stop; True once the brakes may be set.

        That is at rest, or `PATIENCE_S` after the planned end of the stop.
        """
        self.held_back = -1  # the stop is the robot's own
        dq = self._plant.dq
        slow = float(np.abs(dq).max(initial=0.0)) <= REST
        overdue = (self._stopped_for - self._stop_ticks) * self._dt >= PATIENCE_S
        self._stopped_for += 1
        share = max(0.0, 1.0 - self._stopped_for / self._stop_ticks)
        np.multiply(self._stop_speed, share, out=self._wanted)
        self._wanted -= dq
        self._wanted /= self._dt
        self._drive(self._wanted)
        return slow or overdue

    def limit_of(self, joint: int) -> int:
        """Return the limit, `Event.LIMIT_*`, that clipped a joint in the last period."""
        return self._limit_of(joint, float(self.value[joint]))

    def _limit_of(self, joint: int, ddq: float) -> int:
        rounded = 1.0 - base.ROUNDING
        if abs(ddq) >= self._brake[joint] * rounded:
            return base.ACCELERATION
        ahead = abs(self._plant.dq[joint] + PERIODS_AHEAD * self._dt * ddq)
        fastest = self._description.velocity[joint] * (1.0 - self._margin[1])
        return base.SPEED if ahead >= fastest * rounded else base.POSITION

    def _apply(self, command: FloatArray) -> int:
        self.held_back = self._pass(command)
        self.interventions += self.held_back >= 0
        return self.held_back

    def _pass(self, command: FloatArray) -> int:
        """Let through what the bounds allow of a command; the first joint held back, or -1."""
        return self._drive(command)

    def _drive(self, ddq: FloatArray) -> int:
        """Accelerate as the bounds allow; the first joint held back, or -1."""
        self._bounds.solve(self._plant.q, self._plant.dq, self._lower, self._upper)
        held: int = self._clamp(ddq, self._lower, self._upper, self.value)
        return held


class TorqueFilter(AccelerationFilter):
    """Torques whose accelerations are within those bounds.

    A model of the plant says what a torque gives; where that is outside the bounds, it is cut to
    them, and turned into torques again. Where efforts are too small for these, the bounds cannot be
    kept: `torque_limited` counts it.

    To brake, all joints decelerate less where one lacks the effort, as far as the bounds allow: cut
    one by one, the torques of the others would throw it about, and it could not even stand.
    """

    def __init__(
        self, description: RobotDescription, plant: Plant, hold_ticks: int, model: TorqueModel
    ) -> None:
        super().__init__(description, plant, hold_ticks, TORQUE_MARGIN)
        n = description.n
        self._body = model
        self._ddq, self._allowed = np.zeros(n), np.zeros(n)
        self._short = False  # the effort of a joint is what holds it back

    def limit_of(self, joint: int) -> int:
        """Return the limit, `Event.LIMIT_*`, that clipped a joint in the last period."""
        return base.TORQUE if self._short else self._limit_of(joint, float(self._allowed[joint]))

    def _pass(self, command: FloatArray) -> int:
        short = self._body.accelerations(command, self._dt, self._ddq)
        self._bounds.solve(self._plant.q, self._plant.dq, self._lower, self._upper)
        held: int = self._clamp(self._ddq, self._lower, self._upper, self._allowed)
        self._short = held < 0
        if held < 0:
            np.copyto(self.value, command)
            self.overloaded = -1
            return short
        return self._give(held)

    def _drive(self, ddq: FloatArray) -> int:
        self._bounds.solve(self._plant.q, self._plant.dq, self._lower, self._upper)
        held: int = self._clamp(ddq, self._lower, self._upper, self._allowed)
        share = self._body.share(self._allowed, self._dt)
        if 0.0 <= share < 1.0:
            np.multiply(self._allowed, share * (1.0 - ROUNDING), out=self._ddq)
            if self._clamp(self._ddq, self._lower, self._upper, self._ddq) < 0:
                np.copyto(self._allowed, self._ddq)
        return self._give(held)

    def _give(self, held: int) -> int:
        self.overloaded = self._body.torques(self._allowed, self._dt, self.value)
        self.torque_limited += self.overloaded >= 0
        return held


class FreeBaseFilter(TorqueFilter):
    """Torques of a robot that may fall: they are cut to the efforts, joint by joint.

    What its joints do is the ground's doing as well as the motors', and torques that kept them
    within bounds of acceleration would push it over. Their ends are stops of the plant. To brake it
    does as every robot with torques.
    """

    def __init__(
        self, description: RobotDescription, plant: Plant, hold_ticks: int, model: TorqueModel
    ) -> None:
        super().__init__(description, plant, hold_ticks, model)
        self._effort, self._short = np.array(description.effort), True
        self._least = -self._effort

    def _pass(self, command: FloatArray) -> int:
        self.overloaded = -1
        held: int = self._clamp(command, self._least, self._effort, self.value)
        return held
