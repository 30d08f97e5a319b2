"""Margins m ≥ 0 of a posture, kept by (25): −∇m·u ≤ η·m, or −∇m·q̈ ≤ 2ηṁ + η²m + m̈ at q̈ = 0."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from hoap3.remote_controller.constraints import limit_reference
from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    Constraint,
    Rows,
    fitted_rate,
    sides,
)
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, numbers

Array = NDArray[np.float64]

BARRIER: dict[str, Any] = {"eta_per_s": 10.0, "reserve_m": 1e-5, "return_speed_m_s": 0.05}
ROUNDED = 9  # decimals of a metre that corners of soles are rounded to


class Barrier(Constraint):
    """A row for each margin."""

    yields: ClassVar[bool] = True
    has_rows: ClassVar[bool] = True
    is_conditional = True

    @abstractmethod
    def look(self) -> tuple[Array, Array]:
        """Margins (s,) [m] and −∇m (s, n) where `robot` is."""

    def rows(self, state: Any, number: int) -> Rows:
        """(25) for each margin."""
        m, A = self.look()
        self.margins[number] = m.min(initial=np.inf)
        given = (self.settings[key] for key in BARRIER)
        A, b = limit_reference.rows(m, A, *given)
        return Rows(A, b, np.ones(len(b), bool))

    def fit(self, speed: Array, brake: Array) -> None:
        """Lower η to what joints can brake with."""
        given = self.settings["eta_per_s"], self.description.period_s
        self._eta = fitted_rate(*given, speed, brake)

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """(25) once more, for ṁ + ηm in place of m."""
        self.margins, A = self.look()
        given = self._eta, self.settings["reserve_m"], self.settings["return_speed_m_s"]
        A, upper = limit_reference.accelerations(self.margins, A, dq, self.bend(dq), *given)
        return sides(A, -np.inf, upper, dq, self._eta)

    @abstractmethod
    def bend(self, dq: Array) -> Array:
        """−m̈ where q̈ = 0, (s,) [m/s²], where `look` was called last."""

    def margins_here(self) -> Array:
        """Return m."""
        return self.look()[0]


class SupportPolygon(Barrier):
    """The centre of mass above the soles, less a margin."""

    defaults: ClassVar[Mapping[str, Any]] = {**BARRIER, "soles": None, "margin_m": 0.0}

    def prepare(self) -> None:
        """Find the soles."""
        self._area = Area(self)

    def begin(self, state: Any) -> None:
        """Lay out the area where the soles are."""
        self._area.lay_out(self)

    def look(self) -> tuple[Array, Array]:
        """n·c − o and −n·J for each edge."""
        c, J = self.robot.com(self._area.frame)
        return self._area.inside(c), -self._area.normals @ J[:2]

    def bend(self, dq: Array) -> Array:
        """−n·J̇q̇ for each edge."""
        del dq
        return np.asarray(-self._area.normals @ self.robot.com_drift(self._area.frame)[:2])


class HalfSpace(Barrier):
    """n·p ≥ offset of a point that is fixed to a frame."""

    defaults: ClassVar[Mapping[str, Any]] = {
        **BARRIER,
        "frame": str,
        "point_m": None,
        "reference": None,
        "normal": None,
        "offset_m": 0.0,
    }

    def prepare(self) -> None:
        """Read the plane."""
        given = self.settings
        self._frame = self.robot.known(given["frame"])
        self._reference = self.robot.known(given["reference"] or self.description.base_frame)
        self._point = np.array(numbers(given["point_m"] or (0.0, 0.0, 0.0), 3, "point_m"))
        self._normal = direction(given["normal"])

    def look(self) -> tuple[Array, Array]:
        """n·p − offset, and −n·(v + ω × r)."""
        origin, axes, J = self.robot.frame(self._frame, self._reference)
        arm, n = axes @ self._point, self._normal
        m = float(n @ (origin + arm)) - self.settings["offset_m"]
        row = n @ J[:3] + np.cross(arm, n) @ J[3:]
        return np.array([m]), -row[None]

    def bend(self, dq: Array) -> Array:
        """−n·(a + α × r + ω × (ω × r)), a and α of the frame where q̈ = 0."""
        _, axes, J = self.robot.frame(self._frame, self._reference)
        drift, omega = self.robot.frame_drift(self._frame, self._reference), J[3:] @ dq
        arm = axes @ self._point
        found = drift[:3] + np.cross(drift[3:], arm) + np.cross(omega, np.cross(omega, arm))
        return np.array([-self._normal @ found])


class Area:
    """The convex hull of soles, seen from the first of them, laid out where they are at a begin.

    Args:
        constraint: with `soles` and `margin_m`.

    Attributes:
        frame: of the first sole.
        normals: (k, 2) unit, inwards; with `offsets`, (k,) [m], n·p ≥ offset inside.
    """

    def __init__(self, constraint: Constraint) -> None:
        robot, given = constraint.description, constraint.settings
        self._outlines = {sole.frame: np.array(sole.polygon) for sole in robot.soles}
        if not self._outlines:
            raise UnverifiableError("the robot has no soles")
        base = robot.base_frame
        usual = base if base in self._outlines else next(iter(self._outlines))
        self._soles = list(given["soles"] or [usual])
        if any(sole not in self._outlines for sole in self._soles):
            raise UnverifiableError(f"soles are {self._soles!r:.60}")
        self.frame, self._margin = self._soles[0], given["margin_m"]

    def lay_out(self, constraint: Constraint) -> None:
        """Take the soles as they are."""
        corners = []
        for sole in self._soles:
            p, axes, _ = constraint.robot.frame(sole, self.frame)
            corners.append(p[:2] + self._outlines[sole] @ axes[:2, :2].T)
        edges = ConvexHull(np.round(np.vstack(corners), ROUNDED)).equations
        self.normals, self.offsets = -edges[:, :2], edges[:, 2] + self._margin

    def inside(self, point: Array) -> Array:
        """How far a point (2,) or more is inside of each edge, (k,) [m]."""
        return np.asarray(self.normals @ point[:2] - self.offsets)


def direction(given: object) -> Array:
    """Three numbers at length 1."""
    vector = np.array(numbers(given, 3, "a direction"))
    if not vector.any():
        raise UnverifiableError("a direction is 0")
    return np.asarray(vector / np.linalg.norm(vector))
