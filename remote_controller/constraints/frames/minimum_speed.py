"""Never slower than a least speed in one direction."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.frames.half_space import Triple, unit
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

ORTHOGONAL = 1e-6  # of the cosine between the direction and ∇V


class MinimumSpeed(Constraint):
    """a(q)·u ≥ s: the speed of weighted joints, or of a frame's origin in one direction.

    u = 0 is not allowed, so V can only be promised to decrease where a is orthogonal to ∇V
    (QP12, section III-E). `accepts` judges this for a ∇V; the event `not_orthogonal` counts
    where it does not hold, and the controller leaves the row out then. Where a = 0 there is no
    such speed; the event `no_direction` counts it, and the row is off.

    For accelerations the excess h = a·q̇ − s is kept by ḣ ≥ −η·h, a·q̈ ≥ −η·h − ȧ·q̇; a frame that
    is too slow gathers speed at rate η. Its margin is h.
    """

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "local linearisation"
    margin_unit = "rad/s or m/s"

    class Parameters(Constraint.Parameters):
        """Direction and least speed; either `joints` or `frame` and `direction`."""

        speed: float = Field(gt=0, description="s [rad/s for joints, m/s for a frame]")
        joints: dict[str, float] = Field({}, description="a by joint name, without unit")
        frame: str | None = Field(None, description="whose origin moves")
        reference: str | None = Field(None, description="seen from; none: the base frame")
        direction: Triple | None = Field(None, description="of the frame's motion, any length")
        eta_per_s: float = Field(
            10.0,
            gt=0,
            description="for accelerations: rate at which it nears s, at most 1/period [1/s]",
        )
        tolerance: float = Field(
            ORTHOGONAL, ge=0, lt=1, description="largest |cos| between a and ∇V, beside rounding"
        )

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        self._speed, self._tolerance = parameters.speed, parameters.tolerance
        self._eta = self.rate_of(parameters)
        self._direction: FloatArray | None = None
        self._a = np.zeros(self.n)
        if bool(parameters.joints) == (parameters.frame is not None):
            remedy = "Write either joints, or frame and direction"
            raise ConfigError("", "joints", None, "has not exactly one direction", remedy)
        if parameters.frame is None:
            self._a[self.joint_indices("joints", parameters.joints)] = list(
                parameters.joints.values()
            )
            if not self._a.any():
                raise ConfigError("", "joints", parameters.joints, "is 0", "Weight some joint")
        elif parameters.direction is None:
            raise ConfigError("", "direction", None, "is missing", "Add it beside frame")
        else:
            self._direction = unit(parameters.direction, "direction")
            self._frame = kinematics.frame_id(parameters.frame)
            self._seen_from = kinematics.frame_id(
                parameters.reference or self.description.base_frame
            )
            self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
            self._jacobian = np.zeros((6, self.n))
        self.rows, self.names = 1, (f"{parameters.frame or ' '.join(parameters.joints)}",)
        self.events.update(not_orthogonal=0, no_direction=0)

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write −a·u ≤ −s."""
        if self._measure(kinematics):
            np.negative(self._a, out=A_out[0])
            b_out[0] = -self._speed
        else:
            A_out[0], b_out[0] = 0.0, np.inf

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Have a margin, h [rad/s or m/s]."""
        self.margins, self.margin_names = np.full(1, np.inf), self.names
        self._drift = np.zeros(6)

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write −a·q̈ ≤ η(a·q̇ − s) + ȧ·q̇."""
        lower_out[0] = -np.inf
        if not self._measure(motion.kinematics):
            G_out[0], upper_out[0], self.margins[0] = 0.0, np.inf, np.inf
            return
        np.negative(self._a, out=G_out[0])
        self.margins[0] = self._a @ motion.dq - self._speed
        upper_out[0] = self._eta * self.margins[0]
        if self._direction is not None:
            motion.frame_drift(self._frame, self._seen_from, self._drift)
            upper_out[0] += self._direction @ self._drift[:3]
        self.watch()

    def _measure(self, kinematics: Kinematics) -> bool:
        """Find a; whether there is such a direction."""
        if self._direction is not None:
            kinematics.frame(
                self._frame, self._seen_from, self._position, self._rotation, self._jacobian
            )
            np.dot(self._direction, self._jacobian[:3], out=self._a)
        if np.abs(self._a).max() < 1e-9:
            self.events["no_direction"] += 1
            return False
        return True

    def accepts(self, gradient: FloatArray) -> bool:
        """Whether |cos(a, ∇V)| ≤ tolerance, of the last update; also where either is 0."""
        lengths = float(np.linalg.norm(self._a) * np.linalg.norm(gradient))
        orthogonal = abs(float(self._a @ gradient)) <= max(self._tolerance, 1e-12) * lengths
        self.events["not_orthogonal"] += not orthogonal
        return orthogonal
