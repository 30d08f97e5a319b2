"""Trajectories: the splines of scipy through the points that the log encloses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicSpline
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import nearer
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target

Array = NDArray[np.float64]
TRAJECTORY = "trajectory"
FOLDER = "motion/"  # what the names of enclosed motions begin with
QUATERNION = ["qx", "qy", "qz", "qw"]
PARTS = {"position", "velocity", "acceleration"}
DERIVATIVES = {"linear": 0, "cubic": 1, "quintic": 2}
"""How many derivatives each interpolation keeps at the points."""


class Trajectory(Target):
    """Through points at times: BPoly.from_derivatives of what is given or found at each.

    Args:
        times: (k,) of the points [s], scaled.
        points: position, velocity and acceleration at each, (3, k, m), scaled.
        kept: how many derivatives the interpolation keeps.
        approach_s: to the first point where that is at 0, by a quintic [s].
        places, dimension: which components those columns are, of how many; others stay.
    """

    def __init__(
        self,
        times: Array,
        points: Array,
        kept: int,
        approach_s: float,
        places: Sequence[int],
        dimension: int,
    ) -> None:
        super().__init__(dimension)
        self._places, self._points, self._kept = list(places), points, kept
        lead, self._lead_kept = (times[0], kept) if times[0] > 0.0 else (approach_s, 2)
        self._lead, self._times = float(lead), float(lead) + times - times[0]
        self.end_s = float(self._times[-1])
        self._path = BPoly.from_derivatives(self._times, self._at_points(points, kept))
        self._slope = self._path.derivative()
        self.start(None, 0.0)

    def start(self, present: Array | None, time_s: float) -> None:
        """Set out from where the robot is to the first point."""
        super().start(present, time_s)
        first = self._points[:, 0].copy()
        if self._kept == 0:
            first[1:] = 0.0
        origin = np.zeros_like(first)
        origin[0] = first[0] if present is None else present[self._places]
        if self._lead > 0.0:
            ends = self._at_points(np.stack([origin, first], axis=1), self._lead_kept)
            self._way = BPoly.from_derivatives([0.0, self._lead], ends)
            self._way_slope = self._way.derivative()

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """On the way to the first point, between points, or at the last."""
        place, velocity = self._origin.copy(), np.zeros(self.dimension)
        if elapsed_s >= self.end_s:
            place[self._places] = self._points[0, -1]
            return place, velocity
        leads = elapsed_s < self._lead
        path, slope = (self._way, self._way_slope) if leads else (self._path, self._slope)
        place[self._places], velocity[self._places] = path(elapsed_s), slope(elapsed_s)
        return place, velocity

    @staticmethod
    def _at_points(points: Array, kept: int) -> Array:
        """As scipy takes them, (k, kept + 1, m)."""
        return points[: kept + 1].swapaxes(0, 1)


def trajectory_of(given: Mapping[str, Any], names: Sequence[str], *, turns: bool = False) -> Target:
    """The target of a config's trajectory.

    Args:
        given: its settings.
        names: of the task's components, in their order.
        turns: whether a quaternion may be there as well, for three more of them.

    Raises:
        UnverifiableError: the points are not in the log, or are none.
    """
    text = given.get("csv")
    if not isinstance(text, str) or not text:
        raise UnverifiableError("the points of a trajectory are not in the log")
    header, *lines = [line for line in text.splitlines() if line.strip()]
    titles = [_meaning(title.strip(), names) for title in header.split(",")]
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    column = dict(zip(titles[1:], table.T[1:], strict=True))
    scaling = float(given.get("time_scaling", 1.0))
    times = table[:, 0] * scaling
    there = [name for name in names if (name, "position") in column]
    place = np.column_stack([column[name, "position"] for name in there])
    if turns and (QUATERNION[0], "position") in column:
        turn = np.column_stack([column[name, "position"] for name in QUATERNION])
        place = np.hstack([place, _turns(turn)])
    velocity = CubicSpline(times, place, bc_type="clamped")(times, 1)
    acceleration = np.zeros_like(place)
    moves = [(name, "velocity") for name in there]
    kept = 0
    if moves[0] in column:
        kept = 1
        velocity[:, : len(there)] = np.column_stack([column[name] for name in moves]) / scaling
    bends = [(name, "acceleration") for name in there]
    if bends[0] in column:
        kept = 2
        bent = np.column_stack([column[name] for name in bends])
        acceleration[:, : len(there)] = bent / scaling**2
    kept = DERIVATIVES.get(given.get("interpolation") or "", kept)
    places = [list(names).index(name) for name in there]
    extra = place.shape[1] - len(there)
    places += [len(names) + i for i in range(extra)]
    points = np.stack([place, velocity, acceleration])
    approach = float(given.get("approach_s", 1.0))
    return Trajectory(times, points, kept, approach, places, len(names) + extra)


def _meaning(title: str, names: Sequence[str]) -> tuple[str, str]:
    """A column's name and whether it is its position, velocity or acceleration."""
    name, _, part = title.rpartition("/")
    if part in PARTS and unquote(name) in {*names, *QUATERNION}:
        return unquote(name), part
    return unquote(title), "position"


def with_motions(content: Any, attachments: Mapping[str, bytes]) -> Any:
    """A config with the points that a log encloses beside it, under `csv`."""
    if isinstance(content, Mapping):
        enclosed = attachments.get(f"{FOLDER}{content.get('file')}")
        if content.get("kind") == TRAJECTORY and enclosed is not None:
            return {**content, "csv": enclosed.decode("utf-8", "replace")}
        return {key: with_motions(value, attachments) for key, value in content.items()}
    if isinstance(content, list):
        return [with_motions(each, attachments) for each in content]
    return content


def _turns(quaternions: Array) -> Array:
    """Rotation vectors, each the one that is nearest to that before, (k, 3)."""
    last, found = np.zeros(3), []
    for turn in Rotation.from_quat(quaternions).as_rotvec():
        last = nearer(turn, last)
        found.append(last)
    return np.array(found)
