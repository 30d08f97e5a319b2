"""Frames that stay or keep moving, and equations between the joints' velocities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.remote_controller.constraints.frames.fixed_frame_reference import displacement, slope
from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.barrier_oracle import direction
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    GREATEST_SHARE,
    Constraint,
    Rows,
    sides,
)
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import SOURCES
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, numbers

Array = NDArray[np.float64]

AXES = ("x", "y", "z", "rx", "ry", "rz")
NO_DIRECTION = 1e-9  # of a: no joint moves it
ROUNDING = 1e-12  # of a cosine


class FixedFrame(Constraint):
    """J·u = −η·e: a frame keeps its first pose; of the turn by θ about a, e is sin θ·a."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "frame": str,
        "reference": None,
        "axes": None,
        "eta_per_s": 10.0,
    }
    equality: ClassVar[bool] = True
    has_rows: ClassVar[bool] = True

    def prepare(self) -> None:
        """Find the frames and the axes."""
        given, base = self.settings, self.description.base_frame
        self._frames = tuple(map(self.robot.known, (given["frame"], given["reference"] or base)))
        names = list(dict.fromkeys(given["axes"] or AXES))
        if any(name not in AXES for name in names):
            raise UnverifiableError(f"axes are {names!r:.60}")
        self._axes = [AXES.index(name) for name in names]

    def begin(self, state: Any) -> None:
        """Take the pose."""
        p, R, _ = self.robot.frame(*self._frames)
        self._kept = p.copy(), R.copy()

    def rows(self, state: Any, number: int) -> Rows:
        """One equation for each axis."""
        p, R, J = self.robot.frame(*self._frames)
        rates = slope(R, self._kept[1], J)[self._axes]
        b = -self.settings["eta_per_s"] * displacement(p, R, *self._kept)[self._axes]
        return Rows(rates, b, np.ones(len(b), bool))

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """J·q̈ = −J̇q̇ − 2ηė − η²e, with ηT ≤ 0.6.

        For D = R·R₀ᵀ, Ḋ = ω × D, the rate of the turn is S(D)·ω with S(D) = (tr D·I − D)/2, and
        S is linear.
        """
        eta = min(self.settings["eta_per_s"], GREATEST_SHARE / self.description.period_s)
        p, R, J = self.robot.frame(*self._frames)
        kept, omega = self._kept[1], J[3:] @ dq
        drift = slope(R, kept, self.robot.frame_drift(*self._frames)[:, None])[:, 0]
        turning = np.concatenate([np.zeros(3), omega])[:, None]
        drift += slope(pin.skew(omega) @ R, kept, turning)[:, 0]
        G, e = slope(R, kept, J), displacement(p, R, *self._kept)
        b = (-2.0 * eta * (G @ dq) - eta**2 * e - drift)[self._axes]
        return sides(G[self._axes], b, b, dq, eta)


class MinimumSpeed(Constraint):
    """a·u ≥ s of weighted joints, or of a frame's origin; left out unless a is orthogonal to ∇V."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "speed": float,
        "joints": None,
        "frame": None,
        "reference": None,
        "direction": None,
        "eta_per_s": 10.0,
        "tolerance": 1e-6,
    }
    has_rows: ClassVar[bool] = True

    def prepare(self) -> None:
        """Find the direction."""
        given, base = self.settings, self.description.base_frame
        self._a = np.zeros(self.description.n)
        self._frames: tuple[str, ...] = ()
        if given["frame"] is None:
            weights = given["joints"] or {}
            self._a[self.joints(list(weights))] = numbers(
                list(weights.values()), len(weights), "joints"
            )
        else:
            frames = given["frame"], given["reference"] or base
            self._frames = tuple(map(self.robot.known, frames))
            self._direction = direction(given["direction"])

    def rows(self, state: Any, number: int) -> Rows:
        """−a·u ≤ −s, where a is not 0."""
        side = -self.settings["speed"] if self._moves() else np.inf
        return Rows(-self._a[None], np.array([side]), np.ones(1, bool))

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """−a·q̈ ≤ η(a·q̇ − s) + ȧ·q̇, where a is not 0; a·q̇ − s is a margin."""
        if not self._moves():
            self.margins = np.zeros(0)
            return sides(0.0 * self._a[None], -np.inf, np.full(1, np.inf), dq)
        self.margins = self._a[None] @ dq - self.settings["speed"]
        upper = self.settings["eta_per_s"] * self.margins
        if self._frames:
            upper += float(self._direction @ self.robot.frame_drift(*self._frames)[:3])
        eta = self.settings["eta_per_s"]
        return sides(-self._a[None], -np.inf, upper, dq, eta)

    def _moves(self) -> bool:
        """Find a; return whether it is not 0."""
        if self._frames:
            _, _, J = self.robot.frame(*self._frames)
            self._a = self._direction @ J[:3]
        return bool(np.abs(self._a).max() >= NO_DIRECTION)

    def accepts(self, gradient: Array) -> bool:
        """Whether |cos(a, ∇V)| is within the tolerance."""
        lengths = float(np.linalg.norm(self._a) * np.linalg.norm(gradient))
        most = max(self.settings["tolerance"], ROUNDING) * lengths
        return bool(abs(float(self._a @ gradient)) <= most)


class Pfaffian(Constraint):
    """C·u = 0 with a C from the config."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "matrix": None,
        "function": None,
        "positions_from": SOURCES,
        "eta_per_s": 10.0,
    }
    equality: ClassVar[bool] = True
    has_rows: ClassVar[bool] = True

    def prepare(self) -> None:
        """Read C."""
        if self.settings["function"] is not None:
            raise UnverifiableError("the function that gives C is not in the log")
        rows, n = self.settings["matrix"] or (), self.description.n
        self._C = np.array([numbers(row, n, "matrix") for row in rows]).reshape(-1, n)

    def rows(self, state: Any, number: int) -> Rows:
        """C·u = 0."""
        return Rows(self._C, np.zeros(len(self._C)), np.ones(len(self._C), bool))

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """C·q̈ = −η·C·q̇."""
        b = -self.settings["eta_per_s"] * (self._C @ dq)
        return sides(self._C, b, b, dq, self.settings["eta_per_s"])
