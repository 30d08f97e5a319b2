"""The plots of the QP12 paper, section V: CoM path, V and Ψ, control inputs, active joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.description import COM
from hoap3.protocol.messages import FloatArray
from hoap3.tools.html.canvas import BEYOND, Canvas, canvas, thin
from hoap3.tools.html.drawing import Drawing, Key
from hoap3.tools.html.numbers import count, number, spread, summary
from hoap3.tools.html.palette import LIGHT, SERIES
from hoap3.tools.report.motion import Motion

ROUNDING = 1e-12  # of the greatest V: less is no rise
PROPORTION = 1.7  # width to height of a pair of axes
NAMED = 6  # joints that get a colour of their own
WINDOWS = 160  # in which means and measured rates are taken
_AT_A_LIMIT = "a limit: choose a greater horizon_periods, or smaller gains"
TOLD = {
    "rad/s": (
        "told to move",
        (
            "A position setpoint q* gives u = (q* − a)/T, where a is the reference that the robot "
            "applied (or the measured position, where the controller integrates from that)."
        ),
        "the target: choose a lower γ, or adaptive_gamma",
    ),
    "rad/s²": ("told to accelerate", "They are accelerations, as they were sent.", _AT_A_LIMIT),
    "N m": (
        "given torques",
        (
            "They are torques, as they were sent: what holds the robot is in them, unless the "
            "robot adds it."
        ),
        _AT_A_LIMIT,
    ),
    "unknown unit": ("told something", "They are what was sent.", "the target"),
}
"""By the unit of u: what joints are told, what u is, and where jumps are usual, with a remedy."""


def motion_drawings(motion: Motion) -> list[Drawing]:
    """Every figure that this motion has the data for."""
    drawings = [_sole(motion)] if motion.point == COM else []
    drawings += [_close_up(motion), _positions(motion)]
    if motion.has_certificates:
        drawings += [_lyapunov(motion), _rate(motion)]
    if len(motion.time_s):
        drawings += [_inputs(motion), _active(motion)]
    return drawings


def _sole(motion: Motion) -> Drawing:
    path_mm = 1e3 * motion.path_m[:, :2]
    with canvas("sole", 275) as drawing:
        corners = np.empty((0, 2)) if motion.sole_m is None else 1e3 * motion.sole_m
        if len(corners):
            drawing.axes.fill(*corners.T, facecolor=LIGHT["wash"], edgecolor=LIGHT["faint"])
        _draw_path(drawing, path_mm, motion)
        _fit(drawing.axes, np.vstack([_shown(motion), *corners]))
    keys = [Key("faint", "support polygon", "area")] if motion.sole_m is not None else []
    edge = summary(1e3 * motion.edge_m)
    title = "The centre of mass, seen from above"
    if edge["n"]:
        inside = "stays over the sole" if edge["min"] >= 0.0 else "leaves the sole"
        title = f"The centre of mass {inside}"
    return Drawing(
        "sole",
        title,
        drawing.svg,
        (*keys, *_path_keys(motion)),
        f"distance to the nearest edge: {spread(edge, 'mm')}" if edge["n"] else _points(motion),
        f"Centre of mass m(q) of the measured joint positions, by our own kinematics, seen from "
        f"the frame {motion.frame}; {_every(motion)}. The support polygon is the sole of that "
        "frame, as the robot's description gives it. Paper: Fig. 4.",
        "A path that comes near an edge: a robot that stands on this sole would tip beyond it. "
        "Negative distances are outside.",
    )


def _close_up(motion: Motion) -> Drawing:
    path_mm = 1e3 * motion.path_m[:, :2]
    length = float(np.linalg.norm(np.diff(path_mm, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(path_mm[-1] - path_mm[0]))
    with canvas("path", 275) as drawing:
        _draw_path(drawing, path_mm, motion)
        _fit(drawing.axes, _shown(motion))
    figures = f"{_points(motion)} · length {number(length)} mm · start to end {number(straight)} mm"
    what = "the centre of mass" if motion.point == COM else motion.point
    title = f"The way of {what} to the target, from above"
    if motion.target_m is not None:
        errors = 1e3 * np.linalg.norm(motion.path_m - motion.target_m, axis=1)
        figures += f" · to the target, in space, at the end {number(errors[-1])} mm"
    else:
        title = f"The way of {what}, from above"
    return Drawing(
        "path",
        title,
        drawing.svg,
        _path_keys(motion),
        figures,
        f"The path of {what}, seen from the frame {motion.frame}, by our own kinematics; both axes "
        "have the same scale. Paper: Fig. 4.",
        "Kinks, loops, or an end that is not at the target; a zigzag of one encoder count.",
    )


def _positions(motion: Motion) -> Drawing:
    used = 100.0 * motion.range_used
    room = np.minimum(used, 100.0 - used).min(axis=0)
    order = np.argsort(room, kind="stable")
    named = [int(joint) for joint in order[:NAMED]]
    with canvas("positions") as drawing:
        for joint in order[NAMED:]:
            points = thin(motion.path_time_s, used[:, joint])
            drawing.axes.plot(*points, color=LIGHT["faint"], linewidth=0.8)
        for role, joint in reversed(list(zip(SERIES, named, strict=False))):
            points = thin(motion.path_time_s, used[:, joint])
            drawing.axes.plot(*points, color=LIGHT[role], linewidth=1.4)
        for end in (0.0, 100.0):
            drawing.axes.axhline(end, color=LIGHT["red"], linewidth=1.0, linestyle="--")
        drawing.time(motion.duration_s, "position [% of the usable range]")
    keys = [
        Key(role, f"{motion.joints[joint]} {number(float(room[joint]))} %")
        for role, joint in zip(SERIES, named, strict=False)
    ]
    if len(order) > NAMED:
        keys.append(Key("faint", f"{len(order) - NAMED} others"))
    first, least = motion.joints[named[0]], float(room[named[0]])
    beyond = int((room < 0.0).sum())
    title = f"{first} comes nearest to a limit, to {number(least)} % of its range"
    if beyond:
        title = f"{beyond} of {len(order)} joints leave their usable range"
    return Drawing(
        "positions",
        title,
        drawing.svg,
        (*keys, Key("red", "limits")),
        f"{_points(motion)} · least distance to a limit {number(least)} %",
        "Measured position of each joint within its usable range, as the robot's description gives "
        "it: 0 % is the lower limit, 100 % the upper. The percentage is the joint's least distance "
        "to a limit.",
        "A joint that rests at a limit, or beyond it: the target may ask for more than it can do.",
    )


def _lyapunov(motion: Motion) -> Drawing:
    v, unit = motion.v, _unit(motion)
    with canvas("v") as drawing:
        drawing.axes.plot(*thin(motion.time_s, v), color=LIGHT["blue"])
        drawing.time(motion.duration_s, f"V [{unit}], logarithmic")
        positive(drawing, v)
    known = v[np.isfinite(v)]
    fallen = f"{number(known[0])} → {number(known[-1])} {unit}" if len(known) else ""
    change = np.diff(known) / max(known.max(initial=0.0), 1e-300)
    rises = int((change > ROUNDING).sum())
    title = "V falls, and never rises" if (change < 0.0).any() else "V stays as it is"
    if rises:
        title = f"V rises at {count(rises)} of {count(len(known))} answers"
    return Drawing(
        "v",
        title,
        drawing.svg,
        (Key("blue", "V"),),
        f"{fallen} · {spread(summary(v), unit)}",
        "Lyapunov function V = |e|²/2 of each answer, in the squared unit of the task: m² for the "
        "centre of mass. √(2V) is the error. Paper: Fig. 5a.",
        "A plateau above zero: the motion stalls. A step up: something moved the robot, or a "
        "setpoint was clipped.",
    )


def _rate(motion: Motion) -> Drawing:
    rate = f"{_unit(motion)}/s"
    time, measured, window_s = _measured_fall(motion)
    with canvas("psi") as drawing:
        falling = measured > 0.0
        drawing.axes.plot(
            time[falling], measured[falling], color=LIGHT["orange"], linewidth=7.0, alpha=0.4
        )
        drawing.axes.plot(*thin(motion.time_s, motion.psi), color=LIGHT["blue"])
        drawing.time(motion.duration_s, f"rate of decrease [{rate}], logarithmic")
        positive(drawing, motion.psi)
    share = 100.0 * float(motion.certified.mean())
    return Drawing(
        "psi",
        _how_fast(motion, time, measured),
        drawing.svg,
        (
            Key("blue", "Ψ, required of each answer"),
            Key("orange", f"measured: fall of V over {number(1e3 * window_s)} ms"),
        ),
        f"Ψ: {spread(summary(motion.psi), rate)} · certified {number(share)} % of the answers",
        "Ψ is the least decrease of V per second that the controller had to give, the negative of "
        "v_rate_required; beside it what V really did, from one window to the next. Paper: Fig. 5.",
        "The wide curve below the thin one: the robot does not do what the model says, for it "
        "lags, clips, or missed setpoints. Windows in which V rose are left out.",
    )


def _inputs(motion: Motion) -> Drawing:
    share = motion.work
    order = np.argsort(-share, kind="stable")
    named = [int(joint) for joint in order[:NAMED] if share[joint] > 0.0]
    moved = int((share > 0.0).sum())
    rest = [int(joint) for joint in order[: moved or None] if int(joint) not in named]
    with canvas("u") as drawing:
        for joint in rest:
            points = thin(motion.time_s, motion.inputs[:, joint])
            drawing.axes.plot(*points, color=LIGHT["faint"], linewidth=0.8)
        for role, joint in reversed(list(zip(SERIES, named, strict=False))):
            points = thin(motion.time_s, motion.inputs[:, joint])
            drawing.axes.plot(*points, color=LIGHT[role], linewidth=1.4)
        drawing.time(motion.duration_s, f"u [{motion.unit}]")
    keys = [
        Key(role, f"{motion.joints[joint]} {number(100 * share[joint])} %")
        for role, joint in zip(SERIES, named, strict=False)
    ]
    others = float(sum(share[joint] for joint in rest))
    if rest and moved:
        keys.append(Key("faint", f"{len(rest)} others {number(100 * others)} %"))
    fastest = np.abs(motion.inputs).max(axis=1)
    told, meaning, remedy = TOLD[motion.unit]
    return Drawing(
        "u",
        f"{moved} of {len(motion.joints)} joints are {told}",
        drawing.svg,
        tuple(keys),
        f"greatest |u| of an answer: {spread(summary(fastest), motion.unit)}",
        f"Control inputs u of each answer. {meaning} The percentage is the joint's share of Σ|u|. "
        "Paper: Fig. 8, left.",
        f"Jumps from one tick to the next (chattering), most of all near {remedy}.",
    )


def _active(motion: Motion) -> Drawing:
    time, mean, window_s = means(motion.time_s, motion.active)
    with canvas("active") as drawing:
        drawing.axes.plot(*thin(motion.time_s, motion.active), color=LIGHT["faint"], linewidth=0.8)
        drawing.axes.plot(time, mean, color=LIGHT["blue"])
        drawing.axes.set_ylim(0.0, max(4.0, 1.15 * float(motion.active.max())))
        drawing.axes.yaxis.get_major_locator().set_params(integer=True)
        drawing.time(motion.duration_s, "joints at 0.001 rad/s or more")
    return Drawing(
        "active",
        f"On average {number(float(motion.active.mean()))} of {len(motion.joints)} joints work",
        drawing.svg,
        (Key("faint", "each answer"), Key("blue", f"mean over {number(1e3 * window_s)} ms")),
        f"{spread(summary(motion.active), 'joints')} · mean {number(float(motion.active.mean()))}",
        "Number of joints that move at 0.001 rad/s or more, as the answers themselves say; where "
        "they say nothing, by u, or as measured where u is no speed. Paper: Figs. 6, 7 and 8, "
        "right.",
        "Many joints where γ is high; a band that fills: joints go on and off at every tick.",
    )


def _draw_path(drawing: Canvas, path_mm: FloatArray, motion: Motion) -> None:
    axes = drawing.axes
    axes.plot(*path_mm.T, color=LIGHT["blue"], linewidth=2.0)
    axes.plot(*path_mm[0], "o", color=LIGHT["blue"], markerfacecolor="none", markersize=8)
    axes.plot(*path_mm[-1], "o", color=LIGHT["blue"], markersize=6)
    if motion.target_m is not None:
        x, y = 1e3 * motion.target_m[:2]
        axes.plot(x, y, "+", color=LIGHT["red"], markersize=14, markeredgewidth=1.6)
    drawing.label("x [mm]", "y [mm]")


def _shown(motion: Motion) -> FloatArray:
    """Path and target from above, (m, 2) [mm]."""
    target = [] if motion.target_m is None else [motion.target_m[:2]]
    return np.asarray(1e3 * np.vstack([motion.path_m[:, :2], *target]), float)


def _path_keys(motion: Motion) -> tuple[Key, ...]:
    keys = (Key("blue", "path"), Key("blue", "start", "ring"), Key("blue", "end", "dot"))
    return (*keys, Key("red", "target", "cross")) if motion.target_m is not None else keys


def _fit(axes: Any, points_mm: FloatArray) -> None:
    """Show these points at one scale for both axes, in as much of the figure as that allows."""
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    middle, size = (low + high) / 2.0, high - low
    half = 0.58 * max(size[0], size[1] * PROPORTION, 1.0)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half / PROPORTION, middle[1] + half / PROPORTION)
    axes.set_aspect("equal", adjustable="box")


def positive(drawing: Canvas, values: FloatArray) -> None:
    """A logarithmic axis over the positive values; six decades at most below the greatest but one.

    Rounding at the target would otherwise take most of the figure.
    """
    positive = values[(values > 0.0) & (values < BEYOND)]
    if len(positive):
        drawing.log_scale("y")
        top = float(positive.max())
        drawing.axes.set_ylim(max(float(positive.min()), 1e-12 * top) / 2.0, 2.0 * top)


def means(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Middle and mean of each window with values in it, and its length [s]."""
    length = max((time[-1] - time[0]) / WINDOWS, 1e-9)
    place = ((time - time[0]) / length).astype(int).clip(0, WINDOWS - 1)
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    pieces = np.split(values, begins[1:])
    middles = time[0] + (place[begins] + 0.5) * length
    return middles, np.array([piece.mean() for piece in pieces]), float(length)


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
    """What the median window says of V beside Ψ."""
    known = np.isfinite(motion.psi)
    if not known.any():
        return "Nobody says how fast V has to fall"
    asked = np.interp(time, motion.time_s[known], motion.psi[known])
    if not (asked > 0.0).any():
        return "Nothing is asked of V"
    share = float(np.median((measured / np.where(asked > 0.0, asked, np.nan))[asked > 0.0]))
    if share >= 0.95:
        return "V falls as fast as Ψ asks"
    return f"V falls at {100.0 * max(share, 0.0):.0f} % of the rate that Ψ asks"


def _unit(motion: Motion) -> str:
    """Of V: that of a centre of mass, where its target is known."""
    return "m²" if motion.target_m is not None else "unit²"


def _points(motion: Motion) -> str:
    return f"n {count(len(motion.path_m))} States"


def _every(motion: Motion) -> str:
    return "every State" if motion.every == 1 else f"one State of {motion.every}"
