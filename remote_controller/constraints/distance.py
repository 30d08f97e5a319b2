"""Distances: the robot's links from each other, and from obstacles."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from protocol.description import RobotDescription
from protocol.errors import ConfigError, nearest
from protocol.messages import FloatArray, State
from remote_controller.constraints.bodies import AnyObstacle, Body, links
from remote_controller.constraints.constraint import Constraint, check_rate
from remote_controller.kinematics import Kinematics

Pair = tuple[str, str]


class Distance(Constraint):
    """d(q) ≥ clearance for pairs of bodies, by (25): −∇d·u ≤ η·(d − clearance), margins in m.

    Bodies are the links, with the first <collision> shape that the URDF gives each, and the
    obstacles. The first of a pair is taken as a capsule: of two links the more slender one, of a
    link and an obstacle the link; the second is what it is (`bodies`). Closed forms serve here
    rather than a collision library: GJK gives one pair of nearest points, which jumps from end to
    end of parallel capsules, whereas three rows a pair stay continuous (`distance_kernels`), and
    one kernel does all pairs at once.

    Only pairs whose margin is below the activation distance have rows, so it must be so large
    that none comes from there to 0 faster than at rate η. Margins above it, the smallest one
    excepted, may be lower bounds. Reserve and return are those of
    `barrier`. Events: `rows_short` (pairs that were near but found no row: the nearest ones have
    them), `crossing` (pairs whose cores cross, where the way out leads through the nearest face),
    `immovable` (rows that no joint can help).
    """

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
            5e-4, gt=0, description="how much further than the nearest point others may be [m]"
        )
        rows: int = Field(150, ge=3, description="most rows, three for each near pair")
        eta_per_s: float = Field(10.0, gt=0, description="η of (25), at most 1/period [1/s]")
        reserve_m: float = Field(
            1e-5, ge=0, description="kept for the curvature that one Euler step does not see [m]"
        )
        return_speed_m_s: float = Field(
            0.05, gt=0, description="fastest return from outside that is asked for [m/s]"
        )

    def __init__(
        self,
        parameters: Parameters,
        description: RobotDescription,
        kinematics: Kinematics,
        period_s: float,
    ) -> None:
        from remote_controller.constraints.distance_kernels import (  # noqa: PLC0415 - compiles
            distance_rows,
        )

        super().__init__(parameters, description, kinematics, period_s)
        check_rate(parameters.eta_per_s, period_s)
        self._write_rows = distance_rows
        self._settings = np.array(
            (
                *(parameters.clearance_m, parameters.activation_m, parameters.spread_m),
                *(parameters.eta_per_s, parameters.reserve_m, parameters.return_speed_m_s),
            )
        )
        self._links = links(description)
        self._obstacles: dict[str, Body] = {}
        for place, obstacle in enumerate(parameters.obstacles):
            if obstacle.name in self._links or obstacle.name in self._obstacles:
                key = f"obstacles.{place}.name"
                raise ConfigError("", key, obstacle.name, "is taken", "Choose another name")
            self._obstacles[obstacle.name] = obstacle.body(description.base_frame)
        self.rows = parameters.rows
        self.names = tuple(f"near {row}" for row in range(self.rows))
        self.events.update(rows_short=0, crossing=0, immovable=0)
        self._place(self._chosen(parameters, kinematics), kinematics)

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write rows for the pairs that are near."""
        least, short, crossing, immovable = self._measure(kinematics, A_out, b_out)
        self.events["rows_short"] += short
        self.events["crossing"] += crossing
        self.events["immovable"] += immovable
        self.watch(least)

    def _measure(
        self, kinematics: Kinematics, A_out: FloatArray, b_out: FloatArray
    ) -> tuple[float, int, int, int]:
        origins, rotations, twists, order = kinematics.frames()
        return self._write_rows(
            origins,
            rotations,
            twists,
            order,
            *self._bodies,
            self._pairs,
            self._carried,
            self._settings,
            self.margins,
            A_out,
            b_out,
        )

    def _chosen(self, parameters: Parameters, kinematics: Kinematics) -> list[tuple[Body, Body]]:
        """The pairs that the settings ask for, the capsule first."""
        robot = self.description
        bodies = {**self._links, **self._obstacles}
        if parameters.pairs == "auto":
            names = list(self._links)
            apart = [
                (first, second)
                for place, first in enumerate(names)
                for second in names[place + 1 :]
                if _joints_between(robot, first, second) >= parameters.joints_apart
            ]
            pairs = [_ordered(bodies[first], bodies[second]) for first, second in apart]
            self._place(pairs, kinematics)
            kinematics.update(robot.initial_position)
            self._measure(kinematics, np.zeros((self.rows, self.n)), np.zeros(self.rows))
            pairs = [pair for pair, margin in zip(pairs, self.margins, strict=True) if margin > 0.0]
        else:
            pairs = []
            for place, (first, second) in enumerate(parameters.pairs):
                key = f"pairs.{place}"
                one, other = _named(bodies, first, key), _named(bodies, second, key)
                if first == second:
                    remedy = "Name two bodies"
                    raise ConfigError("", key, first, "is no pair", remedy)
                pairs.append(_ordered(one, other))
        for obstacle in self._obstacles.values():
            for link in self._exposed(parameters, obstacle):
                pairs.append((link.as_capsule(), obstacle))
        return pairs

    def _exposed(self, parameters: Parameters, obstacle: Body) -> list[Body]:
        """Links that are kept from an obstacle."""
        if parameters.obstacle_links != "auto":
            return [
                _named(self._links, name, f"obstacle_links.{place}")
                for place, name in enumerate(parameters.obstacle_links)
            ]
        if obstacle.frame not in self.description.frames:
            return []  # `_place` names the frame
        return [
            link
            for name, link in self._links.items()
            if _joints_between(self.description, name, obstacle.frame) > 0
        ]

    def _place(self, pairs: list[tuple[Body, Body]], kinematics: Kinematics) -> None:
        """Lay out the arrays that the kernel reads."""
        for obstacle in self._obstacles.values():
            kinematics.frame_id(obstacle.frame)
        bodies = list({body.key: body for pair in pairs for body in pair}.values())
        place = {body.key: number for number, body in enumerate(bodies)}
        self._bodies = (
            np.array([kinematics.frame_id(body.frame) for body in bodies], np.int64),
            np.array([body.center for body in bodies]).reshape(-1, 3),
            np.array([body.axes for body in bodies]).reshape(-1, 3, 3),
            np.array([body.half for body in bodies]).reshape(-1, 3),
            np.array([body.radius for body in bodies], np.float64),
        )
        self._pairs = np.array(
            [(place[first.key], place[second.key]) for first, second in pairs], np.int64
        ).reshape(-1, 2)
        self._carried = np.zeros((len(pairs), self.n))
        moved_by = {
            body.frame: kinematics.moved_by(kinematics.frame_id(body.frame)) for body in bodies
        }
        for carried, (first, second) in zip(self._carried, pairs, strict=True):
            carried[moved_by[first.frame] & ~moved_by[second.frame]] = 1.0
            carried[moved_by[second.frame] & ~moved_by[first.frame]] = -1.0
        self.margins = np.full(len(pairs), np.inf)
        self.margin_names = tuple(f"{first.name} to {second.name}" for first, second in pairs)


def _ordered(first: Body, second: Body) -> tuple[Body, Body]:
    """The more slender one first, as a capsule."""
    if second.slenderness > first.slenderness:
        first, second = second, first
    return first.as_capsule(), second


def _named(bodies: dict[str, Body], name: str, key: str) -> Body:
    if name not in bodies:
        guess = nearest(name, bodies)
        hint = f"Did you mean {guess!r}? " if guess else ""
        remedy = f"{hint}Bodies: {', '.join(bodies) or 'none'}"
        raise ConfigError("", key, name, "no link with a <collision> shape is called so", remedy)
    return bodies[name]


def _joints_between(description: RobotDescription, first: str, second: str) -> int:
    """Number of movable joints on the way from one link to another."""
    above = {joint.child: joint for joint in description.structure.joints}
    movable = description.structure.movable
    passed: list[set[str]] = []
    for link in (first, second):
        names, here = set(), link
        while here in above:
            names.add(above[here].name)
            here = above[here].parent
        passed.append(names & movable.keys())
    return len(passed[0] ^ passed[1])
