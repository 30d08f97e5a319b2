"""The plots of the QP12 paper, section V: CoM path, V and Ψ, control inputs, active joints."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import COM
from hoap3.tools.analysis.canvas import WINDOWS, Canvas, Drawing, Key, canvas, means
from hoap3.tools.analysis.numbers import count, number, spread, summary
from hoap3.tools.analysis.report.motion import Motion
from hoap3.tools.analysis.report.posture_views import posture_views
from hoap3.tools.picture.palette import LIGHT, SERIES

ROUNDING = 1e-12  # of the greatest V: less is no rise
PROPORTION = 1.7  # width to height of a pair of axes
NAMED = 6  # joints that get a colour of their own
NO_RATE = "The controller requires no rate of decrease of V (Ψ is never positive)"
WHY_V_RISES = (
    "V rises when the target moves away faster than the robot follows, or when limits hold joints"
)
COMMANDED = {"rad/s": "velocities", "rad/s²": "accelerations", "N m": "torques"}
"""Commands, by the unit of u."""


def motion_drawings(motion: Motion, robot: str | None = None) -> list[Drawing]:
    """Every figure that this motion has the data for; `robot` as for `posture_views`."""
    drawings = posture_views(motion, robot)
    if motion.point == COM:
        drawings.append(_sole(motion))
    drawings.append(_close_up(motion))
    if motion.target_moves:
        drawings.append(_tracking(motion))
    if np.isfinite(motion.range_used).any():
        drawings.append(_positions(motion))
    if motion.has_certificates:
        drawings.append(_lyapunov(motion))
        drawings += [_rate(motion)] if motion.requires_decrease else []
    if len(motion.time_s):
        drawings += [_inputs(motion), _active(motion)]
    return drawings


def _sole(motion: Motion) -> Drawing:
    corners = np.empty((0, 2)) if motion.sole_m is None else 1e3 * motion.sole_m
    with canvas("sole", 275) as drawing:
        if len(corners):
            drawing.axes.fill(*corners.T, facecolor=LIGHT["wash"], edgecolor=LIGHT["faint"])
        _draw_path(drawing, motion, corners)
    keys = [Key("faint", "support polygon", "area")] if motion.sole_m is not None else []
    edge = summary(1e3 * motion.edge_m)
    title, figures = "The centre of mass, seen from above", _points(motion)
    if edge["n"]:
        inside = "stays over the sole" if edge["min"] >= 0.0 else "leaves the sole"
        title = f"The centre of mass {inside}"
        figures = f"distance to the nearest edge: {spread(edge, 'mm')}"
    return Drawing("sole", title, drawing.svg, (*keys, *_path_keys(motion)), figures)


def _close_up(motion: Motion) -> Drawing:
    path_mm = 1e3 * motion.path_m[:, :2]
    length = float(np.linalg.norm(np.diff(path_mm, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(path_mm[-1] - path_mm[0]))
    with canvas("path", 275) as drawing:
        _draw_path(drawing, motion)
    figures = f"{_points(motion)} · length {number(length)} mm · start to end {number(straight)} mm"
    what = "the centre of mass" if motion.point == COM else motion.point
    title = f"Path of {what}, seen from above"
    if motion.target_m is not None:
        title = f"Path of {what} to the target, seen from above"
        if motion.target_moves:
            title = f"Paths of {what} and of its target, seen from above"
        error = 1e3 * float(np.linalg.norm(motion.path_m[-1] - motion.target_m[-1]))
        figures += f" · to the target, in space, at the end {number(error)} mm"
    return Drawing("path", title, drawing.svg, _path_keys(motion), figures)


def _tracking(motion: Motion) -> Drawing:
    """The point and its target over time, axis by axis, both from where the target was first."""
    target = np.empty((0, 3)) if motion.target_m is None else motion.target_m
    first = motion.known_target_m[0]
    with canvas("tracking") as drawing:
        for axis, role in enumerate(SERIES[:3]):
            point_mm = 1e3 * (motion.path_m[:, axis] - first[axis])
            drawing.line(motion.path_time_s, point_mm, role, 2.6)
            target_mm = 1e3 * (target[:, axis] - first[axis])
            drawing.line(motion.path_time_s, target_mm, "red", 1.0, "--")
        drawing.time(motion.duration_s, "position, from the first target [mm]")
    error = summary(1e3 * np.linalg.norm(motion.path_m - target, axis=1))
    what = "the centre of mass" if motion.point == COM else motion.point
    keys = tuple(Key(role, f"{axis} of {what}") for role, axis in zip(SERIES, "xyz", strict=False))
    return Drawing(
        "tracking",
        f"Position of {what} and its target, at most {number(error.get('max', np.nan))} mm apart",
        drawing.svg,
        (*keys, Key("red", "target of each", "dash")),
        f"distance to the target: {spread(error, 'mm')}",
    )


def _positions(motion: Motion) -> Drawing:
    used = 100.0 * motion.range_used
    room = motion.limit_room
    endless = int(np.isnan(room).sum())  # sorted to the end
    order = np.argsort(room, kind="stable")[: len(room) - endless].tolist()
    named = order[:NAMED]
    with canvas("positions") as drawing:
        _draw_joints(drawing, motion.path_time_s, used, named, order[NAMED:])
        for end in (0.0, 100.0):
            drawing.threshold(end, "red")
        drawing.time(motion.duration_s, "position [% of the usable range]")
    keys = _joint_keys(motion, named, room)
    if len(order) > NAMED:
        keys.append(Key("faint", f"{len(order) - NAMED} others"))
    least = number(float(room[named[0]]))
    beyond = int((room < 0.0).sum())
    title = (
        f"Joint positions: {motion.joints[named[0]]} is nearest to a limit, {least} % of its range"
    )
    if beyond:
        title = f"{beyond} of {len(order)} joints leave their usable range"
    figures = f"{_points(motion)} · least distance to a limit {least} %"
    if endless:
        figures += f" · {endless} joints without limits"
    return Drawing("positions", title, drawing.svg, (*keys, Key("red", "limits", "dash")), figures)


def _lyapunov(motion: Motion) -> Drawing:
    v, unit = motion.v, _unit(motion)
    with canvas("v") as drawing:
        drawing.line(motion.time_s, v, "blue")
        drawing.time(motion.duration_s, f"V [{unit}], logarithmic")
        drawing.log_positive(v)
    known = v[np.isfinite(v)]
    fallen = f"{number(known[0])} → {number(known[-1])} {unit}" if len(known) else ""
    change = np.diff(known) / max(known.max(initial=0.0), 1e-300)
    rises = int((change > ROUNDING).sum())
    title = "V decreases at every answer" if (change < 0.0).any() else "V is constant"
    if rises:
        title = f"V rises at {count(rises)} of {count(len(known))} answers"
    figures = f"{fallen} · {spread(summary(v), unit)}"
    if not motion.requires_decrease:
        figures += f" · {NO_RATE}; {WHY_V_RISES}" if rises else f" · {NO_RATE}"
    return Drawing("v", title, drawing.svg, (Key("blue", "V"),), figures)


def _rate(motion: Motion) -> Drawing:
    rate = f"{_unit(motion)}/s"
    time, measured, window_s = _measured_fall(motion)
    falling = measured > 0.0
    with canvas("psi") as drawing:
        wide = {"color": LIGHT["orange"], "linewidth": 7.0, "alpha": 0.4}
        drawing.axes.plot(time[falling], measured[falling], **wide)
        drawing.line(motion.time_s, motion.psi, "blue")
        drawing.time(motion.duration_s, f"rate of decrease [{rate}], logarithmic")
        drawing.log_positive(motion.psi)
    share = 100.0 * float(motion.certified.mean())
    fall = f"measured: fall of V over {number(1e3 * window_s)} ms"
    keys = (Key("blue", "Ψ, required of each answer"), Key("orange", fall))
    figures = f"Ψ: {spread(summary(motion.psi), rate)} · certified {number(share)} % of the answers"
    return Drawing("psi", _how_fast(motion, time, measured), drawing.svg, keys, figures)


def _inputs(motion: Motion) -> Drawing:
    share = motion.work
    moved = int((share > 0.0).sum())
    order = np.argsort(-share, kind="stable").tolist()[: moved or None]
    named, rest = (order[:NAMED], order[NAMED:]) if moved else ([], order)
    with canvas("u") as drawing:
        _draw_joints(drawing, motion.time_s, motion.inputs, named, rest)
        drawing.time(motion.duration_s, f"u [{motion.unit}]")
    keys = _joint_keys(motion, named, 100 * share)
    if rest and moved:
        others = float(sum(share[joint] for joint in rest))
        keys.append(Key("faint", f"{len(rest)} others {number(100 * others)} %"))
    commands = COMMANDED.get(motion.unit, "values")
    title = f"Commanded {commands}: {moved} of {len(motion.joints)} joints move"
    fastest = np.abs(np.maximum(motion.inputs.max(axis=1), -motion.inputs.min(axis=1)))
    figures = f"largest |u| of an answer: {spread(summary(fastest), motion.unit)}"
    return Drawing("u", title, drawing.svg, tuple(keys), figures)


def _active(motion: Motion) -> Drawing:
    time, mean, window_s = means(motion.time_s, motion.active)
    with canvas("active") as drawing:
        drawing.line(motion.time_s, motion.active, "faint", 0.8)
        drawing.axes.plot(time, mean, color=LIGHT["blue"])
        drawing.axes.set_ylim(0.0, max(4.0, 1.15 * float(motion.active.max())))
        drawing.axes.yaxis.get_major_locator().set_params(integer=True)
        drawing.time(motion.duration_s, "joints at 0.001 rad/s or more")
    average = number(float(motion.active.mean()))
    title = f"On average {average} of {len(motion.joints)} joints are active"
    keys = (Key("faint", "each answer"), Key("blue", f"mean over {number(1e3 * window_s)} ms"))
    figures = f"{spread(summary(motion.active), 'joints')} · mean {average}"
    return Drawing("active", title, drawing.svg, keys, figures)


def _draw_joints(
    drawing: Canvas, time: FloatArray, values: FloatArray, named: list[int], rest: list[int]
) -> None:
    """A curve for each joint, the first of those with a colour of their own on top."""
    for joint in rest:
        drawing.line(time, values[:, joint], "faint", 0.8)
    for role, joint in reversed(list(zip(SERIES, named, strict=False))):
        drawing.line(time, values[:, joint], role, 1.4)


def _joint_keys(motion: Motion, named: list[int], shares: FloatArray) -> list[Key]:
    return [
        Key(role, f"{motion.joints[joint]} {number(float(shares[joint]))} %")
        for role, joint in zip(SERIES, named, strict=False)
    ]


def _draw_path(drawing: Canvas, motion: Motion, around: FloatArray | None = None) -> None:
    """The way from above, at one scale for both axes; `around` it, (m, 2) [mm], is shown, too."""
    axes, path_mm = drawing.axes, 1e3 * motion.path_m[:, :2]
    shown = path_mm if around is None else np.vstack([path_mm, around])
    axes.plot(*path_mm.T, color=LIGHT["blue"], linewidth=2.0)
    axes.plot(*path_mm[0], "o", color=LIGHT["blue"], markerfacecolor="none", markersize=8)
    axes.plot(*path_mm[-1], "o", color=LIGHT["blue"], markersize=6)
    target = 1e3 * motion.known_target_m[:, :2]
    if len(target):
        shown = np.vstack([shown, target])
        axes.plot(*target.T, color=LIGHT["red"], linewidth=1.0)
        axes.plot(*target[-1], "+", color=LIGHT["red"], markersize=14, markeredgewidth=1.6)
    drawing.label("x [mm]", "y [mm]")
    low, high = shown.min(axis=0), shown.max(axis=0)
    middle, size = (low + high) / 2.0, high - low
    half = 0.58 * max(size[0], size[1] * PROPORTION, 1.0)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half / PROPORTION, middle[1] + half / PROPORTION)
    axes.set_aspect("equal", adjustable="box")


def _path_keys(motion: Motion) -> tuple[Key, ...]:
    keys = (Key("blue", "path"), Key("blue", "start", "ring"), Key("blue", "end", "dot"))
    if motion.target_moves:
        return (*keys, Key("red", "path of the target"), Key("red", "target at the end", "cross"))
    return (*keys, Key("red", "target", "cross")) if len(motion.known_target_m) else keys


def _measured_fall(motion: Motion) -> tuple[FloatArray, FloatArray, float]:
    """Rate at which V really fell between the ends of windows; negative where it rose."""
    known = np.isfinite(motion.v)
    time, v = motion.time_s[known], motion.v[known]
    length = (time[-1] - time[0]) / WINDOWS
    ends = np.unique(np.searchsorted(time, time[0] + length * np.arange(WINDOWS + 1)))
    ends = ends[ends < len(time)]
    fall = -np.diff(v[ends]) / np.diff(time[ends])
    middle = (time[ends][1:] + time[ends][:-1]) / 2.0
    return middle, fall, float(length)


def _how_fast(motion: Motion, time: FloatArray, measured: FloatArray) -> str:
    """Compare the decrease of V in the median window with Ψ."""
    known = np.isfinite(motion.psi)
    asked = np.interp(time, motion.time_s[known], motion.psi[known])
    if not (asked > 0.0).any():
        positive = count(int((motion.psi > 0.0).sum()))
        return f"A decrease of V is required in {positive} of {count(int(known.sum()))} answers"
    share = float(np.median((measured / np.where(asked > 0.0, asked, np.nan))[asked > 0.0]))
    if share >= 0.95:
        return "V decreases at least as fast as required"
    return f"V decreases at {100.0 * max(share, 0.0):.0f} % of the required rate"


def _unit(motion: Motion) -> str:
    """Of V."""
    return "m²" if motion.v_in_metres else "unit²"


def _points(motion: Motion) -> str:
    return f"n {count(len(motion.path_m))} States"
