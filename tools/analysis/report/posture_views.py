"""The robot in space, at a few moments of its motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from markupsafe import Markup

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.constraints.support.polygon import hull
from hoap3.tools.analysis.canvas import BEYOND, Drawing, Key
from hoap3.tools.analysis.numbers import count, seconds
from hoap3.tools.analysis.report.moments import Moment
from hoap3.tools.analysis.report.motion import Motion
from hoap3.tools.picture.body import Body, Placement
from hoap3.tools.picture.marks import Marks
from hoap3.tools.picture.meshes import dressed
from hoap3.tools.picture.stage import Stage
from hoap3.tools.picture.svg import svg

SIZE = (340.0, 340.0)  # px
MARGIN = 14.0
FACES = 500  # of the robot: a report stays small, whatever it shows
TOUCHING_M = 0.005  # above the ground
PLACES = {"start": "at its start", "worst": "at its worst tick", "end": "at its end"}
_VIEW = Markup('<div class="view">{}<p><b>{}</b> · {} s, tick {}{}</p></div>')


def posture_views(motion: Motion, robot: str | None = None) -> list[Drawing]:
    """One drawing with all moments; none where there is nothing that can be drawn.

    Args:
        motion: what is shown.
        robot: name or path of the robot on this machine, whose meshes are drawn.
    """
    description = motion.description
    if description is None:
        return []
    solids, notes = dressed(description, robot, FACES)
    body = Body(description, FACES, solids)
    seen = []
    for moment in motion.moments:
        placement = body.place(moment.q, moment.base)
        marks = _marks(motion, description, moment, placement)
        if (np.abs(body.points(placement)) < BEYOND).all():  # not so of NaN
            seen.append((moment, placement, marks))
    if not seen:
        return []
    stages = _stages(body, seen)
    views = Markup("").join(
        _VIEW.format(
            Markup(svg(stage.paint(placement, marks), *SIZE)),  # noqa: S704 - our own
            moment.name,
            seconds(moment.time_s),
            count(moment.tick),
            f" · {moment.why}" if moment.why else "",
        )
        for (moment, placement, marks), stage in zip(seen, stages, strict=True)
    )
    square = stages[0].floor.square
    figures = f"n {len(seen)} of {count(motion.states)} States · squares of {square:g} m"
    if body.left_out:
        figures += f" · {count(body.left_out)} small shapes are left out"
    figures = " · ".join((figures, *notes))
    places = [PLACES[moment.name] for moment, *_ in seen]
    title = f"The robot {' and '.join(filter(None, (', '.join(places[:-1]), places[-1])))}"
    shown = '<div class="views">{}</div>'
    return [Drawing("views", title, shown.format(views), _keys(seen), figures, wide=True)]


Seen = list[tuple[Moment, Placement, Marks]]


def _stages(body: Body, seen: Seen) -> list[Stage]:
    """One for all; where the base moves, one for each that goes with it, in the same scale."""
    if not len(seen[0][0].base):
        _, placements, marks = zip(*seen, strict=True)
        return [Stage.around(body, placements, marks, SIZE, MARGIN)] * len(seen)
    stages = [Stage.around(body, [place], [marks], SIZE, MARGIN) for _, place, marks in seen]
    scale = min(stage.camera.scale for stage in stages)
    return [replace(stage, camera=replace(stage.camera, scale=scale)) for stage in stages]


def _marks(
    motion: Motion, description: RobotDescription, moment: Moment, placement: Placement
) -> Marks:
    """What the motion is about, in the world of one moment."""
    until = motion.path_time_s <= moment.time_s + 0.5 * description.period_s
    place = placement.to_world(motion.frame, _drawable(motion.path_m[until]))
    target = np.empty((0, 3)) if motion.target_m is None else _drawable(motion.target_m[until])
    target = placement.to_world(motion.frame, target)
    return Marks(
        point=place[-1] if len(place) else None,
        target=target[-1] if len(target) else None,
        path=place,
        way=target if motion.target_moves else None,
        support=_support(motion, description, placement, free=len(moment.base) > 0),
        plumb=motion.point == COM,
    )


def _drawable(path: FloatArray) -> FloatArray:
    """Its points that can be drawn; not those of NaN."""
    return path[(np.abs(path) < BEYOND).all(axis=1)]


def _support(
    motion: Motion, description: RobotDescription, placement: Placement, *, free: bool
) -> FloatArray | None:
    """Of a centre of mass the sole that the motion is judged by; on a free base what it stands on.

    Corners (c, 2 or 3) in the world.
    """
    if not free:
        if motion.sole_m is None:
            return None
        flat = np.column_stack((motion.sole_m, np.zeros(len(motion.sole_m))))
        return placement.to_world(motion.frame, flat)
    corners = [
        placement.to_world(sole.frame, np.column_stack((sole.polygon, np.zeros(len(sole.polygon)))))
        for sole in description.soles
    ]
    every = np.concatenate([np.empty((0, 3)), *corners])
    touching = every[every[:, 2] < TOUCHING_M, :2]
    return hull(touching) if len(touching) else None


def _keys(seen: Seen) -> tuple[Key, ...]:
    marks = [each for _, _, each in seen]
    com = any(each.plumb for each in marks)
    keys = [
        Key("blue", "centre of mass" if com else "what is moved", "dot"),
        Key("blue", "its way"),
    ]
    if com:
        keys.append(Key("blue", "straight down", "dash"))
    if any(each.target is not None for each in marks):
        keys.append(Key("red", "target", "cross"))
    if any(each.way is not None for each in marks):
        keys.append(Key("red", "path of the target"))
    if any(each.support is not None for each in marks):
        keys.append(Key("green", "support polygon"))
    return tuple(keys)
