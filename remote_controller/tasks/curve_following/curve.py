"""Curves as the common zero of functions (QP12, 21): what persistent motion circulates."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.plugins import PluginGroup
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.references.curves import AXES, Plane
from hoap3.remote_controller.tasks.lyapunov import BuildContext

Positive = Annotated[float, Field(gt=0)]

CURVES = PluginGroup(
    "curve",
    "hoap3.curves",
    {
        "joint_ellipse": "hoap3.remote_controller.tasks.curve_following.curve:JointEllipse",
        "ellipse": "hoap3.remote_controller.tasks.curve_following.curve:SpaceEllipse",
    },
    ("hoap3.remote_controller.tasks.curve_following.curve:Curve",),
    "extending",
)


class Curve(ABC):
    """{x : α_1(x) = … = α_{m−1}(x) = 0} in ℝᵐ; x are joint positions, or a point in space.

    A subclass writes α and its gradients in `evaluate`, and is built by
    `Class(description, parameters)`. The α_i are functions without other critical points near the
    curve, scaled so that their gradients have a length of about 1 on it: then α is a distance.

    The gradients cannot be independent everywhere if the curve is closed (a circle's vanish at
    its centre); where they are not, motion along the curve slows down and stops.

    Args:
        dimension: m.

    Attributes:
        alpha: α, (m − 1,) [unit of x].
        gradients: ∂α/∂x, (m − 1, m), one a row.
    """

    class Parameters(Settings):
        """Settings of this curve; none here."""

    def __init__(self, dimension: int) -> None:
        self.alpha = np.zeros(dimension - 1)
        self.gradients = np.zeros((dimension - 1, dimension))

    @abstractmethod
    def evaluate(self, x: FloatArray) -> None:
        """Recompute α and its gradients at x, (m,)."""

    def pace(self, x: FloatArray) -> float:
        """Factor of the speed along the curve at x, (m,), ≥ 0; 1 unless a subclass knows better."""
        del x
        return 1.0


class Ellipse(Curve):
    """An ellipse in a plane, all other coordinates at their centre.

    α_1 = ±½r·((d_a/r_a)² + (d_b/r_b)² − 1) with r = √(r_a·r_b) and d = x − centre, and α_k = d_k
    for the others. The sign is such that forward is from a to b.

    Args:
        center: (m,).
        first, second: places of the coordinates a and b.
        radii: r_a and r_b.
    """

    def __init__(
        self, center: FloatArray, first: int, second: int, radii: tuple[float, float]
    ) -> None:
        super().__init__(len(center))
        self._center, self._d = center, np.zeros(len(center))
        self._first, self._second = first, second
        self._squares = radii[0] ** 2, radii[1] ** 2
        others = [k for k in range(len(center)) if k not in {first, second}]
        self._others = np.array(others, int)
        handed = np.linalg.det(np.eye(len(center))[[first, *others, second]])
        self._scale = math.copysign(math.sqrt(radii[0] * radii[1]), handed)
        for row, column in enumerate(self._others):
            self.gradients[1 + row, column] = 1.0

    def evaluate(self, x: FloatArray) -> None:
        """Recompute α and its gradients at x, (m,)."""
        np.subtract(x, self._center, out=self._d)
        a, b = float(self._d[self._first]), float(self._d[self._second])
        squares, scale = self._squares, self._scale
        self.alpha[0] = 0.5 * scale * (a * a / squares[0] + b * b / squares[1] - 1.0)
        np.take(self._d, self._others, out=self.alpha[1:])
        self.gradients[0, self._first] = scale * a / squares[0]
        self.gradients[0, self._second] = scale * b / squares[1]


class JointEllipse(Ellipse):
    """Two joints go round an ellipse, and all others are held.

    The ellipse passes through a posture, where the first joint is at its upper end.
    """

    class Parameters(Settings):
        """Which joints, and round what."""

        joints: tuple[str, str] = Field(description="the two that move")
        radii_rad: tuple[Positive, Positive] = Field(description="of the ellipse, in that order")
        posture: str | None = Field(
            None, description="that it passes through, of the robot; none: the initial one"
        )

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        names, postures = list(description.joint_names), description.postures
        for name in parameters.joints:
            if name not in names:
                raise UnknownNameError("joint", name, names)
        posture = parameters.posture or description.initial_posture
        if posture not in postures:
            raise UnknownNameError("posture", posture, postures)
        first, second = (names.index(name) for name in parameters.joints)
        center = np.array(postures[posture])
        center[first] -= parameters.radii_rad[0]
        super().__init__(center, first, second, parameters.radii_rad)


class SpaceEllipse(Ellipse):
    """A point goes round an ellipse in a plane that is parallel to two axes."""

    class Parameters(Settings):
        """Where, and how large."""

        center_m: tuple[float, float, float] = Field(
            description="of the ellipse, in the frame of reference [m]"
        )
        plane: Plane = Field("xy", description="axes of the ellipse")
        radii_m: tuple[Positive, Positive] = Field(description="along these axes [m]")

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        del description
        super().__init__(np.array(parameters.center_m), *AXES[parameters.plane], parameters.radii_m)


def build_curve(
    name: str, parameters: dict[str, Any], dimension: int, context: BuildContext, key: str
) -> Curve:
    """The configured curve.

    Args:
        name: registered, or `package.module:Class`.
        parameters: its settings.
        dimension: m of the space that it shall lie in.
        context: robot, and where the curve is configured.
        key: of the name, for errors; its parameters stand beside it, at `<key>_parameters`.

    Raises:
        UnknownNameError, ConfigError: it cannot be found, its parameters are wrong, or it lies in
            another space.
    """
    found = CURVES.find(name, context.file, key)
    checked: Any = parse(found.Parameters, parameters, context.file, f"{key}_parameters")
    try:
        curve: Curve = found(context.description, checked)
    except UnknownNameError as error:
        where, problem = f"{key}_parameters", f"the robot has no such {error.kind}"
        remedy = f"It has: {', '.join(error.known)}"
        raise ConfigError(context.file, where, error.name, problem, remedy) from error
    shapes = np.shape(curve.alpha), np.shape(curve.gradients)
    if shapes != ((dimension - 1,), (dimension - 1, dimension)):
        problem = f"has α of shape {shapes[0]} and gradients of shape {shapes[1]}"
        remedy = f"Here a curve needs ({dimension - 1},) and ({dimension - 1}, {dimension})"
        raise ConfigError(context.file, key, name, problem, remedy)
    return curve
