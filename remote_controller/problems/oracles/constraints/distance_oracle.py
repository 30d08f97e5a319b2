"""Distances of links from each other and from obstacles, by (25): −∇d·u ≤ η·(d − clearance).

Of a pair with a sphere or a capsule, that one's core is held against the other one's box; of two
boxes, the edges of each against the other. Points that are nearest, or nearly so, have rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.constraints import limit_reference
from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    ROUNDING,
    Constraint,
    Rows,
    fitted_rate,
    sides,
)
from hoap3.remote_controller.problems.oracles.constraints.bodies_oracle import (
    Pair,
    far_apart,
    joints_between,
    links_of,
    obstacle_of,
    shapes,
)
from hoap3.remote_controller.problems.oracles.constraints.contacts_oracle import (
    ALONE,
    Points,
    Scene,
    Segments,
)

Array = NDArray[np.float64]
Places = NDArray[np.int64]

AUTO = (None, "auto")
IMMOVABLE = 1e-12  # m/rad: no joint changes the distance
NEAREST = 1e-9  # m: beyond the nearest point, where a row has the curvature of the pair's margin
ASIDE = 1e-5  # rad or m: how far the fastest joint is moved for it
AT_REST = 1e-9  # rad/s or m/s: no joint moves


class Distance(Constraint):
    """Rows for pairs that are near; the margin is the smallest distance less the clearance."""

    yields: ClassVar[bool] = True
    has_rows: ClassVar[bool] = True
    is_conditional = True
    defaults: ClassVar[Mapping[str, Any]] = {
        "pairs": None,
        "joints_apart": 4.0,
        "obstacles": None,
        "obstacle_links": None,
        "clearance_m": 0.01,
        "activation_m": 0.05,
        "spread_m": 5e-4,
        "contact_m": 0.02,
        "rows": 200.0,
        "eta_per_s": 10.0,
        "reserve_m": 1e-5,
        "return_speed_m_s": 0.05,
    }

    def prepare(self) -> None:
        """Find the pairs."""
        robot, given, links = self.description, self.settings, links_of(self.description)
        base = robot.base_frame
        obstacles = dict(obstacle_of(one, base) for one in given["obstacles"] or ())
        if given["pairs"] in AUTO:
            self._take(far_apart(robot, links, int(given["joints_apart"])))
            self.robot.place(robot.initial_position)
            margins, *_ = self._measure()
            pairs = [pair for pair, m in zip(self._pairs, margins, strict=True) if m > 0.0]
        else:
            known = {**links, **{name: [body] for name, body in obstacles.items()}}
            pairs = [
                p for first, second in given["pairs"] for p in shapes(known[first], known[second])
            ]
        for body in obstacles.values():
            self.robot.known(body.frame)
            near = given["obstacle_links"]
            if near in AUTO:
                near = [name for name in links if joints_between(robot, name, body.frame)]
            pairs += [pair for name in near for pair in shapes(links[name], [body])]
        self._take(pairs)

    def rows(self, state: Any, number: int) -> Rows:
        """Rows of the points that are near, and the least margin."""
        margins, points = self._points()
        self.margins[number] = margins.min(initial=np.inf)
        given, n = self.settings, self.description.n
        if points is None:
            return Rows(np.zeros((0, n)), np.zeros(0), np.zeros(0, bool))
        A, m = self._approach(points), points.distance - self._around[points.pair]
        eta, back = given["eta_per_s"], given["return_speed_m_s"]
        b = eta * limit_reference.room(m, given["reserve_m"], back / eta)
        still = np.abs(A).max(1) < IMMOVABLE
        asked = points.asked & (len(m) <= given["rows"])
        return Rows(np.where(still[:, None], 0.0, A), np.where(still, np.inf, b), asked)

    def fit(self, speed: Array, brake: Array) -> None:
        """Lower η to what joints can brake with."""
        given = self.settings["eta_per_s"], self.description.period_s
        self._eta = fitted_rate(*given, speed, brake)

    def acceleration_rows(self, dq: Array) -> statement.Rows | None:
        """−∇m·q̈ ≤ 2ηṁ + η²m + m̈ at q̈ = 0, of the points that are near.

        m̈ of the nearest point of a pair is the greater one of 2(m(±ε) − m ∓ εṁ)/ε², which knows
        that another point may be nearest there; of other points that of the points which face each
        other, fixed to their bodies, the lesser one where they are taken along the normal.
        """
        margins, points = self._points()
        self.margins = margins
        if points is None:
            return None
        given, eta = self.settings, self._eta
        A, m = self._approach(points), points.distance - self._around[points.pair]
        speed, bend, doubt = -A @ dq, np.zeros(len(m)), np.zeros(len(m))
        fastest = float(np.abs(dq).max())
        first = m <= margins[points.pair] + NEAREST
        if fastest > AT_REST:
            bend[~first] = self._material(points, np.flatnonzero(~first), dq)
            step, q = ASIDE / fastest, self.robot.positions
            sides_of = []
            for sense in (1.0, -1.0):
                self.robot.place(q + sense * step * dq)
                there = self.margins_here()[points.pair]
                sides_of.append(there - margins[points.pair] - sense * step * speed)
            self.robot.place(q)
            bend[first] = 2.0 * np.maximum(*sides_of)[first] / step**2
            doubt[first] = 0.25 * ROUNDING / step**2
        room = limit_reference.room(m, given["reserve_m"], given["return_speed_m_s"] / eta)
        still = np.abs(A).max(1) < IMMOVABLE
        upper = np.where(still, np.inf, 2.0 * eta * speed + eta**2 * room + bend)
        optional = ~(points.asked & (len(m) <= given["rows"]))
        return sides(
            np.where(still[:, None], 0.0, A), -np.inf, upper, dq, eta, doubt, optional=optional
        )

    def margins_here(self) -> Array:
        """Margins of all pairs, those as far as may be near at the next State exactly."""
        return self._measure(1.1 * self.settings["activation_m"], least=False)[0]

    def _points(self) -> tuple[Array, Points | None]:
        """Return the margins of all pairs, and the points that have rows; None without any."""
        margins, scene, found = self._measure()
        given = self.settings
        near = margins < given["activation_m"]
        if not near.any():
            return margins, None
        contact = margins < given["contact_m"]
        reach = np.maximum(margins + self._around, 0.0)
        reach += np.where(contact, given["spread_m"], ALONE)
        reach = np.where(near, reach, -np.inf)
        return margins, scene.points(found, reach, given["spread_m"], contact)

    def _material(self, points: Points, which: Places, dq: Array) -> Array:
        """n·(p̈₁ − p̈₂) of points that face each other, where q̈ = 0; less where they are taken.

        Joints that move both bodies count as still: they change no distance.
        """
        found, drift = np.zeros(len(which)), self.robot.point_drift
        for place, row in enumerate(which):
            first, second = self._frame_of[self._which[points.pair[row]]]
            frames = self._frames[first], self._frames[second]
            n, at, apart = points.normal[row], points.place[row], points.distance[row]
            self.robot.move_apart(frames[0], frames[1], dq)
            ends = (at, at - apart * n), (at + apart * n, at)
            found[place] = min(n @ (drift(frames[0], a) - drift(frames[1], b)) for a, b in ends)
        if len(which):
            self.robot.move(dq)
        return found

    def _take(self, pairs: Sequence[Pair]) -> None:
        """Lay out the pairs and their bodies."""
        self._pairs = list(pairs)
        bodies = list(dict.fromkeys(body for pair in pairs for body in pair))
        number = {body: i for i, body in enumerate(bodies)}
        self._frames = list(dict.fromkeys(body.frame for body in bodies))
        self._frame_of = np.array([self._frames.index(body.frame) for body in bodies], np.int64)
        self._which = np.array([[number[a], number[b]] for a, b in pairs], np.int64).reshape(-1, 2)
        self._edged = np.array([a.edged and b.edged for a, b in pairs], bool)
        radii = np.array([a.radius + b.radius for a, b in pairs])
        self._around = radii + self.settings["clearance_m"]
        self._centres = np.array([body.centre for body in bodies]).reshape(-1, 3)
        self._axes = np.array([body.axes for body in bodies]).reshape(-1, 3, 3)
        self._half = np.array([body.half for body in bodies]).reshape(-1, 3)
        self._balls = np.linalg.norm(self._half, axis=1)[self._which].sum(1)

    def _measure(
        self, most: float | None = None, *, least: bool = True
    ) -> tuple[Array, Scene, Segments]:
        """Margins of all pairs, (P,), where the robot is; far ones may be lower bounds.

        Also the bodies, and the segments of all pairs that may be near.

        Args:
            most: of the margins that are known exactly [m]; None: `activation_m`.
            least: whether the least margin is known exactly, too.
        """
        most = self.settings["activation_m"] if most is None else most
        placed = [self.robot.in_root(frame) for frame in self._frames]
        self._origins, turns, self._J = (np.array([one[i] for one in placed]) for i in range(3))
        at = self._frame_of
        middles = self._origins[at] + (turns[at] @ self._centres[..., None])[..., 0]
        scene = Scene(middles, turns[at] @ self._axes, self._half, self._which, self._edged)
        apart = middles[self._which[:, 0]] - middles[self._which[:, 1]]
        margins = np.linalg.norm(apart, axis=1) - self._balls - self._around
        may = np.flatnonzero(margins < most)
        margins[may] = np.maximum(margins[may], scene.at_least(may) - self._around[may])
        known = margins < most
        found = self._exactly(margins, scene, known)
        nearer = ~known & (margins < margins[known].min(initial=np.inf))
        if least and nearer.any():
            self._exactly(margins, scene, nearer)
        return margins, scene, found

    def _exactly(self, margins: Array, scene: Scene, which: NDArray[np.bool_]) -> Segments:
        """Write the margins of some pairs."""
        found = scene.segments(np.flatnonzero(which), self.settings["spread_m"])
        least = np.full(len(margins), np.inf)
        np.minimum.at(least, found.pair, found.distance)
        margins[which] = (least - self._around)[which]
        return found

    def _approach(self, points: Points) -> Array:
        """−n·(velocity of the first less that of the second) at each point, by joint, (k, n)."""
        rows = np.zeros((len(points.pair), self.description.n))
        n = points.normal
        for side, sense in ((0, -1.0), (1, 1.0)):
            frames = self._frame_of[self._which[points.pair, side]]
            arm = points.place - self._origins[frames]
            turn = arm[:, [1, 2, 0]] * n[:, [2, 0, 1]] - arm[:, [2, 0, 1]] * n[:, [1, 2, 0]]
            rows += sense * (np.hstack([n, turn])[:, None] @ self._J[frames])[:, 0]
        return rows
