"""A curve that is approached and circulated: V = ½|α|², and one equation more, Tᵀẋ = ζ.

Gonçalves et al., IEEE T-RO 2020, (21) to (23). x are the joints' positions, or a point in space.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, complete, numbers
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import PLANES, rise
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import Rows
from hoap3.remote_controller.tasks.curve_following.curve_reference import tangent

Array = NDArray[np.float64]

CURVES = "task_curve", "joint_curve"
HELD, FREE = 1e-3, 0.1  # independence of the gradients: up to there no motion, from there all of it
LEAST_COSINE = 0.5  # of the turn of T between two cycles
MOTION: dict[str, Any] = {
    "direction": ("forward", "backward"),
    "objective_weights": None,
    "curve_parameters": None,
}
SPACE: dict[str, Any] = {
    **MOTION,
    "point": COM,
    "reference": "r_sole",
    "curve": "ellipse",
    "speed_m_s": float,
    "tolerance_m": None,
}
JOINTS: dict[str, Any] = {
    **MOTION,
    "curve": "joint_ellipse",
    "speed_rad_s": float,
    "tolerance_deg": None,
}
IN_SPACE: dict[str, Any] = {"center_m": None, "plane": tuple(PLANES), "radii_m": None}
IN_JOINTS: dict[str, Any] = {"joints": None, "radii_rad": None, "posture": None}


class Ellipse:
    """α_1 = ±½r·((d_a/r_a)² + (d_b/r_b)² − 1), r = √(r_a·r_b), and α_k = d_k, d = x − centre.

    The sign makes forward lead from a to b: gradients and tangent have a positive determinant.
    """

    def __init__(self, centre: Array, axes: tuple[int, int], radii: list[float]) -> None:
        self._centre, self._axes = centre, list(axes)
        self._others = [k for k in range(centre.size) if k not in axes]
        one = np.eye(centre.size)
        turn = np.linalg.det(one[[axes[0], *self._others, axes[1]]])
        self._scale = float(np.sign(turn) * np.sqrt(radii[0] * radii[1]))
        self._squares = np.square(radii)
        self._rows = one[self._others]

    def at(self, x: Array) -> tuple[Array, Array]:
        """α (m − 1,) and its gradients (m − 1, m) at x, (m,)."""
        d = x - self._centre
        along = d[self._axes] / self._squares
        first = 0.5 * self._scale * (float(along @ d[self._axes]) - 1.0)
        slope = np.zeros((1, x.size))
        slope[0, self._axes] = self._scale * along
        return np.append(first, d[self._others]), np.vstack([slope, self._rows])


class Curve:
    """A `task_curve` or `joint_curve`, as a task with a motion of its own.

    Args:
        entry: of the config, `task` and `parameters`.
        robot: that moves.

    Attributes:
        motion_row, speed: Tᵀ·∂x/∂q (n,) and ζ of the cycle that was looked at last.
        weights: w of φ = ½ Σ w·(dα/dt)², (m − 1,).

    Raises:
        UnverifiableError: a curve that is not known, or parameters that mean nothing.
    """

    def __init__(self, entry: Mapping[str, Any], robot: Robot) -> None:
        self._in_space = entry["task"] == "task_curve"
        usual = SPACE if self._in_space else JOINTS
        given = complete(entry["parameters"], usual, str(entry["task"]))
        if given["curve"] != usual["curve"]:
            raise UnverifiableError(f"the curve {given['curve']!r:.40} is not recomputed here")
        self._fastest = given["speed_m_s" if self._in_space else "speed_rad_s"]
        self._sense = 1.0 if given["direction"] == "forward" else -1.0
        self._frames = ("", "")
        if self._in_space:
            point = given["point"] if given["point"] == COM else robot.known(given["point"])
            self._frames = point, robot.known(given["reference"])
            self._ellipse = _in_space(given["curve_parameters"])
        else:
            self._ellipse = _of_joints(given["curve_parameters"], robot.description)
        count = (3 if self._in_space else robot.description.n) - 1
        weights = list(given["objective_weights"] or (1.0,))
        size = count if len(weights) == count else 1
        self.weights = np.broadcast_to(numbers(weights, size, "objective_weights"), (count,))
        self._last = np.zeros(count + 1)
        self.motion_row, self.speed = np.zeros(robot.description.n), 0.0

    @property
    def watched(self) -> bool:
        """A curve has no tolerances."""
        return False

    def watch(self, robot: Robot, time_s: float) -> None:
        """Nothing to watch."""

    def take_over(self, other: object) -> None:
        """Keep the tangent of the curve whose parameters are changed."""
        if isinstance(other, Curve):
            self._last = other._last

    def begin(self, robot: Robot, time_s: float) -> None:
        """Forget the last tangent."""
        del robot, time_s
        self._last = np.zeros_like(self._last)

    def at(self, robot: Robot, time_s: float) -> Rows:
        """α, ∂α/∂q and no motion of the curve; finds T and ζ as well."""
        del time_s
        x, J = self._see(robot)
        alpha, gradients = self._ellipse.at(x)
        size = np.linalg.norm(gradients, axis=1)
        rest = np.abs(np.diag(np.linalg.qr(gradients.T).R))
        independence = float((rest / size * np.minimum(1.0, size)).min()) if size.all() else 0.0
        T, self.speed = self._last, 0.0
        if independence > HELD:
            T = tangent(gradients, self._sense, self._last)
            if self._last.any() and abs(float(T @ self._last)) < LEAST_COSINE:
                T = self._last
            else:
                self._last = T
                share, _ = rise((independence - HELD) / (FREE - HELD))
                self.speed = self._fastest * share
        self.motion_row = T @ J
        return Rows(alpha, gradients @ J, np.zeros(alpha.size))

    def _see(self, robot: Robot) -> tuple[Array, Array]:
        """The x of the curve and ∂x/∂q."""
        if not self._in_space:
            return robot.positions, np.eye(robot.positions.size)
        point, reference = self._frames
        if point == COM:
            return robot.com(reference)
        p, _, J = robot.frame(point, reference)
        return p, J[:3]


def _in_space(given: object) -> Ellipse:
    curve = complete(given, IN_SPACE, "curve_parameters")
    centre, radii = (
        numbers(curve["center_m"], 3, "center_m"),
        numbers(curve["radii_m"], 2, "radii_m"),
    )
    return Ellipse(np.array(centre), PLANES[curve["plane"]], radii)


def _of_joints(given: object, robot: RobotDescription) -> Ellipse:
    curve = complete(given, IN_JOINTS, "curve_parameters")
    radii, names = numbers(curve["radii_rad"], 2, "radii_rad"), list(robot.joint_names)
    posture = curve["posture"] or robot.initial_posture
    joints = curve["joints"] or ()
    if len(joints) != 2 or any(name not in names for name in joints):
        raise UnverifiableError(f"the joints of a curve are {joints!r:.60}")
    if posture not in robot.postures:
        raise UnverifiableError(f"the posture of a curve is {posture!r:.40}")
    first, second = (names.index(name) for name in joints)
    centre = np.array(robot.postures[posture], float)
    centre[first] -= radii[0]
    return Ellipse(centre, (first, second), radii)
