"""The constraints of controllers of accelerations and torques: rows, bounds, margins and stops.

Where rows and bounds have no common answer, or the robot could not stop in time after this period,
all joints brake together instead, in a straight line and within whole periods.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.acceleration_claims import RELATIVE
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import ROUNDING
from hoap3.remote_controller.problems.oracles.constraints.stack_oracle import constraints_of
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.statement import Array, Claim, Rows

CURVATURE = 1e-6  # of a margin: so far below 0 it counts as kept
LONGEST_S = 1e3  # of a stop: what takes longer is none
STILL = 1e-9  # rad/s² or m/s²: what a joint brakes with at least
BETWEEN = 1e-4  # m: how far below 0 a margin may be on the way of a stop
STOP = 0.5, 1.0  # shares of that way at which margins are looked at


class Constraints:
    """The constraints of a config, with what they remember.

    Args:
        entries: of the config.
        robot: that they are for.
        brake: (n,) what joints brake with, where the robot could with more [rad/s² or m/s²].

    Attributes:
        unknown: reasons why some are not recomputed, by name; of the others there is `known`.
        torque_max: (n,) what they leave of the joints' torques.
        margin, margin_error: the least margin of the newest State, after `rows`.
        rows_error: how exactly the limits of rows of length 1 are known.
    """

    def __init__(self, entries: Sequence[Mapping[str, Any]], robot: Robot, brake: Array) -> None:
        self._robot, self._entries, description = robot, entries, robot.description
        self._speed = np.array(description.velocity)
        self._brake = np.minimum(description.brake_acceleration, brake)
        self._brake = np.minimum(self._brake, description.setpoint_acceleration_max)
        self.margin, self.margin_error, self.rows_error = np.inf, 0.0, 0.0
        self.torque_max = np.full(description.n, np.inf)
        self._read(entries)
        for each in self.known:
            self._speed = np.minimum(self._speed, each.speed_max)
            self._brake = np.minimum(self._brake, each.acceleration_max)
            self.torque_max = np.minimum(self.torque_max, each.torque_max)
        self._fit()

    def __bool__(self) -> bool:
        return bool(self._entries)

    def adopt(self, entries: Sequence[Mapping[str, Any]], first: Any) -> None:
        """Take other parameters; what is remembered since the State `first` stays."""
        if entries == self._entries:
            return
        before, self._entries = self.known, entries
        self._read(entries)
        self._fit()
        if first is not None:
            self.begin(first)
            for new, old in zip(self.known, before, strict=True):
                new.take_over(old)

    def begin(self, state: Any) -> None:
        """Forget everything, at the first State after a reset."""
        self._move(state)
        for each in self.known:
            each.begin(state)

    def follow(self, state: Any) -> None:
        """Remember the newest State."""
        remembering = [each for each in self.known if each.has_memory]
        if remembering:
            self._move(state)
        for each in remembering:
            each.follow(state)

    def narrow(self, q: Array, dq: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return what they leave of bounds of q̈, (n,): those of accelerations themselves first."""
        for each in sorted(self.known, key=lambda each: not each.limits_accelerations):
            found = each.interval(q, dq)
            if found is not None:
                lower, upper = (np.clip(side, lower, upper) for side in found)
        return lower, upper

    def rows(self, dq: Array, ddq: Array, ddq_error: Array) -> tuple[Rows, ...]:
        """Return rows of length 1 where `robot` is placed and moved, exact for an answer q̈."""
        found, self.rows_error = [], 0.0
        for each in self.known:
            rows = each.acceleration_rows(dq)
            if rows is None:
                continue
            length = np.linalg.norm(rows.A, axis=1)
            used = (length > 0.0) & ((rows.lower > -np.inf) | (rows.upper < np.inf))
            size = length[used]
            A, sides = rows.A[used] / size[:, None], (rows.lower[used], rows.upper[used])
            error = rows.error[used] / size
            self.rows_error = max(self.rows_error, float(error.max(initial=0.0)))
            error = error + np.abs(A) @ ddq_error
            error += RELATIVE * (1.0 + np.abs(A) @ np.abs(ddq))
            given = {"A_error": rows.A_error[used] / size, "optional": rows.optional[used]}
            found.append(Rows.of(A, *(side / size for side in sides), error=error, **given))
        self.margin = min((each.margin for each in self.known), default=np.inf)
        moving = 1.0 + float(np.abs(dq).sum())
        self.margin_error = ROUNDING * moving * max((e.amplifies for e in self.known), default=0.0)
        return tuple(rows for rows in found if len(rows.a))

    def stop(self, dq: Array) -> Array:
        """Return the q̈ with which a stop begins, (n,)."""
        return np.asarray(-dq / max(self._duration(dq), self._robot.description.period_s))

    def stop_claims(self, q: Array, dq: Array, ddq: Array) -> list[Claim]:
        """Claims that margins stay on their side, or no less than they are, on the way of a stop.

        Args:
            q, dq: (n,) of the newest State.
            ddq: (n,) that is held for this period, from the end of which the stop begins.
        """
        limits = [each for each in self.known if each.is_conditional]
        if not limits:
            return []
        T = self._robot.description.period_s
        after, speed = q + T * (dq + 0.5 * T * ddq), dq + T * ddq
        duration = self._duration(speed)
        if not np.isfinite(duration):
            return [Claim("stop: duration", duration, LONGEST_S, 0.0, "at_most")]
        way = 0.5 * duration * speed
        now = np.minimum(np.concatenate([each.margins for each in limits]), 0.0)
        now[np.isneginf(now)] = 0.0
        least = np.inf
        for share in STOP:
            self._robot.place(after + share * way)
            there = np.concatenate([each.margins_here() for each in limits])
            least = min(least, float((there - now).min(initial=np.inf)))
        self._robot.place(q)
        return [Claim("stop: margin", least, 0.0, BETWEEN, "at_least")]

    def derivative_claims(self) -> list[Claim]:
        """Claims of the derivatives of users' constraints."""
        return [claim for each in self.known for claim in each.derivative_claims()]

    def _read(self, entries: Sequence[Mapping[str, Any]]) -> None:
        given = [(str(each["constraint"])[:60], each.get("parameters")) for each in entries]
        self.known, self.unknown = constraints_of(given, self._robot, "acceleration")

    def _fit(self) -> None:
        for each in self.known:
            each.fit(self._speed, self._brake)

    def _move(self, state: Any) -> None:
        self._robot.place(state["q"])
        self._robot.move(state["dq"])

    def _duration(self, dq: Array) -> float:
        """Return how long all joints brake, in whole periods [s]; inf where that is no stop."""
        T = self._robot.description.period_s
        longest = float((np.abs(dq) / np.maximum(self._brake, STILL)).max())
        return math.ceil(longest / T - 1e-9) * T if longest <= LONGEST_S else math.inf


def tightened(rows: Rows) -> Rows:
    """Return rows that are kept by less than what keeps `rows` to their errors."""
    one = rows.lower == rows.upper
    error = np.where(one, 0.0, rows.error)
    return replace(rows, lower=rows.lower + error, upper=rows.upper - error)
