"""Contacts of a free base: the wrenches that soles can take, and the unknowns that they leave.

With v = (base, joints), the wrenches w of s soles, and the rows u of the base, on which no motor
acts,

    J_c v̇ = a_c,     M_u v̇ + h_u = J_{c,u}ᵀ w,     τ = M_a v̇ + h_a − J_{c,a}ᵀ w.

The first two are 6s + 6 equations of n + 6 + 6s numbers. With an orthonormal basis Z of their null
space, all of (v̇, w/units) that keeps them is the smallest such vector plus Z y, y (n,).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.free_robot_oracle import BASE, FreeRobot
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.statement import Array, Flags

WRENCH, NORMAL = 6, 2  # numbers of each sole's wrench, and which is the normal force
GRAVITY = 9.81  # m/s²
NANOMETRE = 9  # decimals of a length in m
SAME = 9  # decimals in which facets agree that are one
MOST_SOLES = 8  # as there may be 2^s options of which of them carry
DEPENDENT = 1e-7  # of the largest singular value: soles that hold each other
DEFAULTS: dict[str, Any] = {
    "friction": 0.5,
    "margin_m": 0.005,
    "least_share": 0.01,
    "damping_per_s": 20.0,
    "loaded_share": 0.005,
    "within_support": True,
    "lost_after_s": 0.01,
}


class Sole(NamedTuple):
    """One sole.

    Attributes:
        frame: its name.
        corners: of its outline less the margin, in its frame, counter-clockwise, (k, 2) [m].
        units: of its wrench, (6,): 1 N, and for moments that at the farthest corner.
        edges: wrenches of unit normal force along the edges of the friction pyramids at all
            corners, (4k, 6).
        facets: rows of facets·w ≤ 0, which holds for sums of these; of length 1 in `units`, (r, 6).
    """

    frame: str
    corners: Array
    units: Array
    edges: Array
    facets: Array

    @classmethod
    def of(cls, frame: str, polygon: Array, margin_m: float, friction: float) -> Sole:
        """Return the sole of an outline, (k, 2) [m].

        Raises:
            UnverifiableError: nothing is left of the outline, or of its cone.
        """
        try:
            return cls._of(frame, polygon, margin_m, friction)
        except QhullError as error:
            reason = f"contacts: margin {margin_m:g} m or friction {friction:g} leaves nothing"
            raise UnverifiableError(f"{reason} of sole {frame!r:.60}") from error

    @classmethod
    def _of(cls, frame: str, polygon: Array, margin_m: float, friction: float) -> Sole:
        hull = ConvexHull(polygon)
        halves = hull.equations + np.array([0.0, 0.0, margin_m])
        middle = polygon[hull.vertices].mean(axis=0)
        found = HalfspaceIntersection(halves, middle).intersections
        corners = found[ConvexHull(found).vertices]
        reach = float(np.linalg.norm(corners, axis=1).max())
        units = np.array([1.0, 1.0, 1.0, reach, reach, reach])
        edges = np.array([_edge(c, x, y, friction) for c in corners for x in SIGNS for y in SIGNS])
        others = [0, 1, 3, 4, 5]  # the normal force is 1
        planes = ConvexHull((edges / units)[:, others]).equations
        facets = np.insert(planes[:, :5], NORMAL, planes[:, 5], axis=1)
        facets /= np.linalg.norm(facets, axis=1)[:, None]
        _, once = np.unique(np.round(facets, SAME), axis=0, return_index=True)
        facets = facets[np.sort(once)]  # Qhull divides facets into simplices
        return cls(frame, corners, units, edges, facets / units)


SIGNS = (1.0, -1.0)


def _edge(corner: Array, x: float, y: float, friction: float) -> Array:
    """Wrench about the frame's origin of a force at a corner with unit normal force, (6,)."""
    slope = friction / math.sqrt(2.0)  # the pyramid is within the cone
    force = np.array([slope * x, slope * y, 1.0])
    return np.concatenate([force, np.cross([*corner, 0.0], force)])


@dataclass(frozen=True)
class Contact:
    """The soles at a State.

    Attributes:
        J, rate, twist: of all soles in their own axes, (6s, n + 6) and (6s,) each; rate is J̇·v.
        places: origins (3,) [m] and axes (3, 3) in the world, of each sole.
    """

    J: Array
    rate: Array
    twist: Array
    places: list[tuple[Array, Array]]


class Reduced(NamedTuple):
    """All v̇, w and τ that keep the equations, by y (n,): each is start + matrix·y.

    Attributes:
        motion_start, motion: (n + 6,) and (n + 6, n).
        wrench_start, wrench: (6s,) and (6s, n).
        torque_start, torque: (n,) and (n, n).
        units: of the wrenches, (6s,).
        condition: of the equations, by which rounding is amplified.
    """

    motion_start: Array
    motion: Array
    wrench_start: Array
    wrench: Array
    torque_start: Array
    torque: Array
    units: Array
    condition: float

    def y_of(self, motion: Array, wrench: Array) -> Array:
        """Return y of an answer, (n,)."""
        pressed = (wrench - self.wrench_start) / self.units
        found = self.motion.T @ (motion - self.motion_start)
        return np.asarray(found + (self.wrench / self.units[:, None]).T @ pressed)


class Soles:
    """The soles of a robot.

    Args:
        robot: at any configuration.
        settings: `contacts` of the config, complete.
        description: of the robot.

    Raises:
        UnverifiableError: too many soles, or one without area.
    """

    def __init__(
        self, robot: FreeRobot, settings: Mapping[str, Any], description: RobotDescription
    ) -> None:
        self._robot, self.weight = robot, robot.weight
        if len(description.soles) > MOST_SOLES:
            raise UnverifiableError(f"the robot has more than {MOST_SOLES} soles")
        given = float(settings["margin_m"]), float(settings["friction"])
        self.soles = [
            Sole.of(sole.frame, np.array(sole.polygon, float), *given) for sole in description.soles
        ]
        self.damping = float(settings["damping_per_s"])
        self.units = self.weight * np.concatenate([sole.units for sole in self.soles])
        self.normals = np.arange(len(self.soles)) * WRENCH + NORMAL
        count = sum(len(sole.facets) for sole in self.soles)
        self.facets, first = np.zeros((count, WRENCH * len(self.soles))), 0
        for i, sole in enumerate(self.soles):
            last = first + len(sole.facets)
            self.facets[first:last, WRENCH * i : WRENCH * (i + 1)] = sole.facets
            first = last

    def contact(self) -> Contact:
        """Return the soles where the robot is placed and moved."""
        robot = self._robot
        found = [robot.frame_motion(sole.frame, own_axes=True) for sole in self.soles]
        J, twists, rates = (np.concatenate(each) for each in zip(*found, strict=True))
        return Contact(J, rates, twists, [robot.in_root(sole.frame)[:2] for sole in self.soles])

    def outside_cones(self, wrench: Array) -> float:
        """Return how far wrenches are from sums of forces inside the pyramids, by the weight."""
        worst = 0.0
        for sole, part in zip(self.soles, np.split(wrench, len(self.soles)), strict=True):
            felt = part / sole.units / self.weight
            worst = max(worst, float(nnls((sole.edges / sole.units).T, felt)[1]))
        return worst

    def cone_margin(self, wrench: Array) -> float:
        """Return the least distance of wrenches from facets of their cones, by the weight."""
        return float(-(self.facets @ wrench).max() / self.weight)

    def reduced(self, M: Array, h: Array, contact: Contact) -> Reduced | None:
        """Return what is left to choose; None where soles hold each other."""
        J, units, width = contact.J, self.units, len(h)
        whole = 1.0 / float(np.abs(M[:BASE, :BASE]).max())
        E = np.zeros((len(J) + BASE, width + len(J)))
        E[: len(J), :width] = J
        E[len(J) :, :width] = whole * M[:BASE]
        E[len(J) :, width:] = -whole * J[:, :BASE].T * units
        rest = -self.damping * contact.twist - contact.rate
        left, s, Vt = np.linalg.svd(E)
        if not s[-1] > DEPENDENT * s[0]:
            return None
        sides = np.concatenate([rest, -whole * h[:BASE]])
        start, Z = Vt[: len(s)].T @ ((left.T @ sides) / s), Vt[len(s) :].T
        wrench_start, wrench = start[width:] * units, Z[width:] * units[:, None]
        pushed, moved = J[:, BASE:].T, M[BASE:]
        torque_start = moved @ start[:width] + h[BASE:] - pushed @ wrench_start
        return Reduced(
            start[:width],
            Z[:width],
            wrench_start,
            wrench,
            torque_start,
            moved @ Z[:width] - pushed @ wrench,
            units,
            float(s[0] / s[-1]),
        )

    def supported(
        self, wanted: Array, com: Array, contact: Contact, loaded: Flags
    ) -> tuple[Array, float]:
        """Return what of an acceleration of the centre of mass loaded soles give, x and y (2,).

        And how exactly it is known. Corners in the world count to 1 nm: of those in line, rounding
        decides which edge is the nearest.

        The point c − c̈·z/(g + c̈_z) of zero moment is moved into the outline of these soles.

        Args:
            wanted: c̈, (3,) [m/s²].
            com: c, (3,) [m].
            contact: of all soles.
            loaded: (s,).
        """
        chosen = [
            (sole.corners @ axes[:2, :2].T + origin[:2], origin[2])
            for sole, (origin, axes), carries in zip(
                self.soles, contact.places, loaded, strict=True
            )
            if carries
        ]
        height = float(com[2] - np.mean([each[1] for each in chosen]))
        lift = GRAVITY + float(wanted[2])
        if not (height > 0.0 and lift > 0.0):
            return wanted[:2], 0.0
        point = com[:2] - wanted[:2] * height / lift
        corners = np.round(np.concatenate([each[0] for each in chosen]), NANOMETRE)
        within = nearest_within(corners, point)
        error = 8.0 * ROUNDING * (1.0 + float(np.abs(point).max()))
        return (com[:2] - within) * lift / height, error * lift / height


def nearest_within(points: Array, point: Array) -> Array:
    """Return the point of the convex hull of others, (k, 2), that is nearest to one, (2,)."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # all are on a line, as of vertical soles
        pairs = np.array([*combinations(range(len(points)), 2)])
    else:
        if (hull.equations[:, :2] @ point + hull.equations[:, 2] <= 0.0).all():
            return point
        pairs = hull.simplices
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]
    along = end - start
    square = np.maximum((along**2).sum(1), np.finfo(float).tiny)  # points may coincide
    share = ((point - start) * along).sum(1) / square
    feet = start + np.clip(share, 0.0, 1.0)[:, None] * along
    found: Array = feet[int(np.argmin(np.linalg.norm(feet - point, axis=1)))]
    return found


def loaded_options(timers: Array, lost_after_s: float, exact_s: float) -> Sequence[Flags]:
    """Return which soles carry, by how long each has carried too little [s], (s,).

    Where a time is the limit to `exact_s`, either may be, unless the time is exactly 0.
    """
    options: list[list[bool]] = [[]]
    for timer in timers.tolist():
        either = timer > 0.0 and abs(timer - lost_after_s) <= exact_s
        choices = (True, False) if either else (timer <= lost_after_s,)
        options = [[*before, choice] for before in options for choice in choices]
    return [np.array(each, np.bool_) for each in options]
