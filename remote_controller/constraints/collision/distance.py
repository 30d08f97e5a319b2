"""Distances: the robot's links from each other, and from obstacles."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, product
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.barrier import (
    ETA_FIELD,
    RESERVE_FIELD,
    RETURN_SPEED_FIELD,
)
from hoap3.remote_controller.constraints.collision.collision_geometry import (
    AnyObstacle,
    Body,
    links,
)
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.coordinated_stop import reach
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

Pair = tuple[str, str]
CLEARANCE, ACTIVATION, ETA, RETURN = 0, 1, 3, 5  # places in the settings of the kernels


class Distance(Constraint):
    """d(q) ≥ clearance for pairs of bodies, by (25): −∇d·u ≤ η·(d − clearance), margins in m.

    Bodies are the links, with every <collision> shape that the URDF gives them, and the
    obstacles. Between boxes, spheres and capsules d is their distance, exactly; a cylinder is
    taken as a capsule or a box that contains it, so that its d is never more than its distance
    (`bodies`). Closed forms serve here rather than a collision library: GJK gives one pair of
    nearest points, which jumps from end to end of parallel capsules, whereas rows for every
    nearly nearest point stay continuous (`distance_kernels`), and one kernel does all pairs.

    Of bodies whose cores cross, only this is said: the margin is below −clearance, less the
    radii. It counts the deepest middle of an edge's, or a core's, part inside the other, so the
    way out may be longer. A core is a capsule's segment, a sphere's centre, or the box itself.

    Only pairs whose margin is below the activation distance have rows, so it must be so large
    that none comes from there to 0 faster than at rate η. Points that are further than the
    nearest ones by more than `spread_m` have none either: it must be more than bodies move
    relative to each other in a period. Margins above the activation, the smallest one
    excepted, may be lower bounds. Reserve and return are those of
    `barrier`, and so are the rows of accelerations: m̈ of the nearest point is that of the pair's
    margin along the motion, by differences; of others, that of the two points that face each other.
    Events: `rows_short` (pairs that were near but found no row for all their points:
    the nearest pairs have theirs), `crossing` (pairs whose cores cross, where the way out leads
    through the nearest face), `immovable` (rows that no joint can help).
    """

    guarantee: ClassVar[Guarantee] = "conditional"
    margin_unit = "m"
    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    yields = True

    class Parameters(Constraint.Parameters):
        """Pairs, obstacles, clearance."""

        pairs: Literal["auto"] | tuple[Pair, ...] = Field(
            "auto",
            description="of links or obstacles by name; auto: links with at least joints_apart "
            "joints between them that are not nearer than the clearance in the initial posture",
        )
        joints_apart: int = Field(4, ge=1, description="for auto")
        obstacles: tuple[AnyObstacle, ...] = Field((), description="sphere, capsule or box")
        obstacle_links: Literal["auto"] | tuple[str, ...] = Field(
            "auto", description="links kept from all obstacles; auto: all that move against them"
        )
        clearance_m: float = Field(0.01, ge=0, description="least distance [m]")
        activation_m: float = Field(
            0.05, gt=0, description="margin from which on a pair has rows [m]"
        )
        spread_m: float = Field(
            5e-4,
            ge=1e-6,
            description="how much further than the nearest point others may be to get a row [m]",
        )
        contact_m: float = Field(
            0.02,
            ge=0,
            description="margin below which all these points have rows; above, the nearest [m]",
        )
        rows: int = Field(
            200, ge=3, description="most rows: up to three a near pair, of two boxes four"
        )
        eta_per_s: float = ETA_FIELD
        reserve_m: float = RESERVE_FIELD
        return_speed_m_s: float = RETURN_SPEED_FIELD

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints.collision.distance_kernels import distance_rows

        self._write_rows = distance_rows
        self._brakes: tuple[FloatArray, FloatArray] | None = None  # where rows are of accelerations
        self._settings = np.array(
            (
                *(parameters.clearance_m, parameters.activation_m, parameters.spread_m),
                *(self.rate_of(parameters), parameters.reserve_m, parameters.return_speed_m_s),
                parameters.contact_m,
            )
        )
        self._links = links(self.description)
        self._obstacles: dict[str, tuple[Body, ...]] = {}
        for place, obstacle in enumerate(parameters.obstacles):
            if obstacle.name in self._links or obstacle.name in self._obstacles:
                key = f"obstacles.{place}.name"
                raise ConfigError("", key, obstacle.name, "is taken", "Choose another name")
            self._obstacles[obstacle.name] = (obstacle.body(self.description.base_frame),)
        self.rows = parameters.rows
        self.names = tuple(f"near {row}" for row in range(self.rows))
        self._contacts = np.zeros((self.rows, 9))
        self._full_rows = np.zeros((self.rows, len(kinematics.robot.order)))
        self.events.update(rows_short=0, crossing=0, immovable=0)
        self._place(self._chosen(parameters, kinematics), kinematics)

    def apply(self, parameters: Parameters) -> None:
        """Read η and the speed of the return."""
        self._settings[ETA] = self.rate_of(parameters, self._brakes)
        self._settings[RETURN] = parameters.return_speed_m_s

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write rows for the pairs that are near."""
        self._count(*self._measure(kinematics, A_out, b_out))

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Fit η to the period and the brakes, and size the buffers."""
        from hoap3.remote_controller.constraints.collision import (
            distance_curvature_kernels as kernels,
        )

        self._brakes = speed, deceleration
        self._settings[ETA] = self.rate_of(self.parameters, self._brakes)
        self._margins_at = kernels.distance_margins
        self._accelerate = kernels.distance_accelerations
        self._looks = np.zeros((3, self.margins.size))

        self._aside_settings = self._settings.copy()
        self._aside_settings[ACTIVATION] *= 1.1  # what is near here is measured beside it, too

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write rows for the pairs that are near."""
        self._count(*self._measure(motion.kinematics, G_out, upper_out))
        lower_out[:] = -np.inf
        if self._contacts[0, 0] < 0.0:
            return  # nothing is near
        apart_s = 0.0
        if motion.moves:
            ahead, behind, apart_s = motion.aside()
            self._look(ahead, self._looks[1])
            self._look(behind, self._looks[2])
        self._looks[0] = self.margins
        _, _, twists, order = motion.kinematics.frames()
        mimic_joints, dq, rows = motion.kinematics.mimic_joints, motion.dq, G_out
        if mimic_joints is not None:
            dq, rows = mimic_joints.velocities(dq), self._full_rows
        self._accelerate(
            self._contacts,
            twists,
            order,
            self._carried,
            dq,
            self._looks,
            apart_s / 2.0,
            self._settings,
            rows,
            upper_out,
        )

    def margins_at(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write the margins of any posture; far ones may be lower bounds."""
        self._look(kinematics, out)

    def _look(self, kinematics: Kinematics, margins_out: FloatArray) -> None:
        """Write the margins of a posture."""
        origins, rotations, _, _ = kinematics.frames()
        self._margins_at(
            origins, rotations, *self._bodies, self._pairs, self._aside_settings, margins_out
        )

    def _count(self, least: float, short: int, crossing: int, immovable: int) -> None:
        self.events["rows_short"] += short
        self.events["crossing"] += crossing
        self.events["immovable"] += immovable
        self.watch(least)

    def _measure(
        self, kinematics: Kinematics, A_out: FloatArray, b_out: FloatArray
    ) -> tuple[float, int, int, int]:
        origins, rotations, twists, order = kinematics.frames()
        mimic_joints = kinematics.mimic_joints
        counts = self._write_rows(
            origins,
            rotations,
            twists,
            order,
            *self._bodies,
            self._pairs,
            self._carried,
            self._settings,
            self.margins,
            A_out if mimic_joints is None else self._full_rows,
            b_out,
            self._contacts,
        )
        if mimic_joints is not None:
            mimic_joints.columns(self._full_rows, A_out)
        return counts

    def _chosen(self, parameters: Parameters, kinematics: Kinematics) -> list[tuple[Body, Body]]:
        """The pairs that the settings ask for."""
        robot = self.description
        bodies = {**self._links, **self._obstacles}
        if parameters.pairs == "auto":
            apart = [
                (self._links[first], self._links[second])
                for first, second in combinations(self._links, 2)
                if _joints_between(robot, first, second) >= parameters.joints_apart
            ]
            pairs = _shapes(apart)
            self._place(pairs, kinematics)
            kinematics.update(robot.initial_position)
            self._measure(kinematics, np.zeros((self.rows, self.n)), np.zeros(self.rows))
            pairs = [pair for pair, margin in zip(pairs, self.margins, strict=True) if margin > 0.0]
        else:
            named = []
            for place, (first, second) in enumerate(parameters.pairs):
                key = f"pairs.{place}"
                named.append((_named(bodies, first, key), _named(bodies, second, key)))
                if first == second:
                    raise ConfigError("", key, first, "is no pair", "Name two bodies")
            pairs = _shapes(named)
        for (obstacle,) in self._obstacles.values():
            pairs += _shapes((link, (obstacle,)) for link in self._exposed(parameters, obstacle))
        return pairs

    def _exposed(self, parameters: Parameters, obstacle: Body) -> list[tuple[Body, ...]]:
        """Shapes of each link that is kept from an obstacle."""
        if parameters.obstacle_links != "auto":
            return [
                _named(self._links, name, f"obstacle_links.{place}")
                for place, name in enumerate(parameters.obstacle_links)
            ]
        if obstacle.frame not in self.description.frames:
            return []  # `_place` names the frame
        return [
            shapes
            for name, shapes in self._links.items()
            if _joints_between(self.description, name, obstacle.frame) > 0
        ]

    def _place(self, pairs: list[tuple[Body, Body]], kinematics: Kinematics) -> None:
        """Lay out the arrays that the kernel reads."""
        for (obstacle,) in self._obstacles.values():
            kinematics.frame_id(obstacle.frame)
        bodies = list(dict.fromkeys(body for pair in pairs for body in pair))
        place = {body: number for number, body in enumerate(bodies)}
        halves = np.array([body.half for body in bodies]).reshape(-1, 3)
        radii = np.array([body.radius for body in bodies], np.float64)
        self._bodies = (
            np.array([kinematics.frame_id(body.frame) for body in bodies], np.int64),
            np.array([body.center for body in bodies]).reshape(-1, 3),
            np.array([body.axes for body in bodies]).reshape(-1, 3, 3),
            halves,
            radii,
            radii + np.linalg.norm(halves, axis=1),
        )
        self._pairs = np.array(
            [
                (place[first], place[second], first.edged and second.edged)
                for first, second in pairs
            ],
            np.int64,
        ).reshape(-1, 3)
        self._carried = np.zeros((len(pairs), len(kinematics.robot.order)))
        moved_by = {
            body.frame: kinematics.moved_by(kinematics.frame_id(body.frame)) for body in bodies
        }
        for carried, (first, second) in zip(self._carried, pairs, strict=True):
            carried[moved_by[first.frame] & ~moved_by[second.frame]] = 1.0
            carried[moved_by[second.frame] & ~moved_by[first.frame]] = -1.0
        self.margins = np.full(len(pairs), np.inf)
        self.margin_names = tuple(f"{first.name} to {second.name}" for first, second in pairs)
        sizes = np.linalg.norm(self._bodies[1], axis=1) + self._bodies[5]
        self.reach = reach(kinematics) + 2.0 * float(sizes.max(initial=0.0))
        apart = [first.radius + second.radius for first, second in pairs]
        core = min(apart, default=1.0) + float(self._settings[CLEARANCE])
        self.sharpness = 1.0 / core if core > 0.0 else np.inf


def _shapes(pairs: Iterable[tuple[tuple[Body, ...], tuple[Body, ...]]]) -> list[tuple[Body, Body]]:
    """Every shape of the one with every shape of the other.

    One without edges comes first, of two the shorter one: of its core the nearest points of
    parallel ones are an end or both.
    """

    def rank(body: Body) -> tuple[bool, float]:
        return body.edged, float(body.half[2])

    return [
        (one, other) if rank(one) <= rank(other) else (other, one)
        for first, second in pairs
        for one, other in product(first, second)
    ]


def _named(bodies: dict[str, tuple[Body, ...]], name: str, key: str) -> tuple[Body, ...]:
    if name not in bodies:
        remedy = one_of(name, bodies, "Bodies")
        raise ConfigError("", key, name, "no link with a <collision> shape is called so", remedy)
    return bodies[name]


def _joints_between(description: RobotDescription, first: str, second: str) -> int:
    """Number of movable joints on the way from one link to another."""
    above = {joint.child: joint for joint in description.structure.joints}
    movable = description.structure.moved
    passed: list[set[str]] = []
    for link in (first, second):
        names, here = set(), link
        while here in above:
            names.add(above[here].name)
            here = above[here].parent
        passed.append(names & movable.keys())
    return len(passed[0] ^ passed[1])
