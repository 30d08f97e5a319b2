"""Legends that stand inside their panels, where no curve passes.

Matplotlib's own "best" place is the least bad of nine. Here a fine grid of places is tried, with
one column of names, then with more; where all are taken, the panel is made higher by what the
legend needs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PLACES = (13, 9)  # that are tried across and up
APART = 4.0  # from the edge of a panel, and of curves [px]
LOOK = {
    "fontsize": 7,
    "borderaxespad": 0.0,
    "borderpad": 0.3,
    "handlelength": 1.6,
    "columnspacing": 1.0,
    "labelspacing": 0.25,
    "framealpha": 0.85,
    "facecolor": "white",
    "edgecolor": "none",
}


def place_legend(axes: Any, handles: Mapping[str, Any]) -> None:
    """Put a legend into a panel whose figure has been laid out.

    Args:
        axes: of matplotlib, with all that is drawn in it.
        handles: what is named, by its name.
    """
    taken = _taken(axes)
    low, high = (np.array(each) for each in (axes.bbox.min, axes.bbox.max))
    widest, rows = 1, len(handles) + 1
    for columns in range(1, len(handles) + 1):
        if math.ceil(len(handles) / columns) == rows:
            continue  # no row less
        rows = math.ceil(len(handles) / columns)
        size = _size(_legend(axes, handles, columns))
        room = high - low - size - 2.0 * APART
        if room[0] < 0.0:
            break
        widest = columns
        if room[1] < 0.0:
            continue
        for share in _shares():
            corner = low + APART + share * room
            if not _crosses(taken, corner - APART, corner + size + APART):
                _legend(axes, handles, columns, (corner - low) / (high - low))
                return
    size = _size(_legend(axes, handles, widest))
    _make_higher(axes, float((size[1] + 3.0 * APART) / (high - low)[1]))
    left = 0.5 * (1.0 - size[0] / (high - low)[0])
    bottom = 1.0 - (size[1] + APART) / (high - low)[1]
    _legend(axes, handles, widest, (left, bottom))


def _legend(axes: Any, handles: Mapping[str, Any], columns: int, at: Any = (0.0, 0.0)) -> Any:
    """With its lower left corner at a share of the panel's width and height."""
    where = {"loc": "lower left", "bbox_to_anchor": tuple(at), "ncols": columns}
    legend = axes.legend(handles.values(), handles.keys(), **where, **LOOK)
    legend.set_in_layout(False)
    return legend


def _size(legend: Any) -> Array:
    """Width and height [px]."""
    box = legend.get_window_extent()
    return np.array([box.width, box.height])


def _shares() -> Iterator[Array]:
    """Places from the lower left (0, 0) to the upper right: corners first, then edges."""
    x, y = (np.linspace(0.0, 1.0, count) for count in PLACES)
    every = [np.array(each) for each in itertools.product(x, y)]
    inward = [np.sort(np.minimum(each, 1.0 - each)) for each in every]

    def order(place: int) -> tuple[float, float, float, float]:
        (across, up), (edge, corner) = every[place], inward[place]
        return float(edge), float(corner), float(-up), float(-across)

    return (every[place] for place in sorted(range(len(every)), key=order))


def _taken(axes: Any) -> Array:
    """What is drawn in a panel as short lines: (k, 2, 2), from one point to another [px]."""
    found = []
    for line in axes.get_lines():
        points = np.asarray(line.get_xydata(), float)
        if line.get_drawstyle() == "steps-post":
            points = np.column_stack(
                (np.repeat(points[:, 0], 2)[1:], np.repeat(points[:, 1], 2)[:-1])
            )
        shown = axes.transData.transform(points)
        if line.get_linestyle() == "None":
            found.append(np.stack((shown, shown), axis=1))
        else:
            found.append(np.stack((shown[:-1], shown[1:]), axis=1))
    for patch in axes.patches:
        corners = patch.get_transform().transform(patch.get_path().vertices)
        found.append(np.stack((corners[:-1], corners[1:]), axis=1))
    for inset in axes.child_axes:
        box = inset.get_tightbbox()
        heights = np.append(np.arange(box.y0, box.y1, APART), box.y1)
        left, right = np.full_like(heights, box.x0), np.full_like(heights, box.x1)
        found.append(np.stack([left, heights, right, heights], axis=1).reshape(-1, 2, 2))
    every = np.concatenate([np.empty((0, 2, 2)), *found])
    return np.asarray(every[np.isfinite(every).all(axis=(1, 2))])


def _crosses(lines: Array, low: Array, high: Array) -> bool:
    """Whether a line passes through a box: Y.-D. Liang and B. A. Barsky, ACM TOG 3(1), 1984."""
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - start) / along, (high - start) / along
    still, inside = along == 0.0, (low <= start) & (start <= high)
    never = np.where(inside, -np.inf, np.inf)  # of a line along the other axis
    enters = np.where(still, never, np.minimum(one, other)).max(axis=1)
    leaves = np.where(still, -never, np.maximum(one, other)).min(axis=1)
    return bool(((enters <= leaves) & (enters <= 1.0) & (leaves >= 0.0)).any())


def _make_higher(axes: Any, share: float) -> None:
    """Have what is shown end a share of the height below the upper edge."""
    low, high = axes.get_ylim()
    scale = axes.yaxis.get_transform()
    bottom, top = scale.transform(np.array([low, high]))
    raised = bottom + (top - bottom) / (1.0 - share)
    axes.set_ylim(low, float(scale.inverted().transform(np.array([raised]))[0]))
