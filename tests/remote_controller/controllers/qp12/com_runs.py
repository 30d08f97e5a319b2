"""The experiment of the QP12 paper, section V, in as many variants as tests ask for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import Controller
from hoap3.robot_emulator.robots import load
from hoap3.testing import Body

HOAP3 = load("hoap3")
# The reference figures were computed without the degree that usable limits keep from the stops.
HOAP3_TO_ITS_STOPS = HOAP3.model_copy(
    update={
        "joints": tuple(
            joint.model_copy(update={"lower": joint.lower_hard, "upper": joint.upper_hard})
            for joint in HOAP3.joints
        )
    }
)
TARGET = np.array([0.01, 0.025, 0.2869])
PERIOD = 1e-3
ACTIVE = 1e-3  # rad/s


@dataclass(frozen=True)
class Run:
    """A motion, one row per tick.

    Attributes:
        v, rate, status: of the certificate.
        u: (ticks, n) velocities [rad/s], from setpoints and applied references.
        q, reference: (ticks, n) measured, and as applied [rad].
    """

    v: FloatArray
    rate: FloatArray
    status: FloatArray
    u: FloatArray
    q: FloatArray
    reference: FloatArray

    @property
    def error(self) -> FloatArray:
        """|e| [m]."""
        return np.sqrt(2 * self.v)

    @property
    def active(self) -> np.ndarray:
        return np.abs(self.u) >= ACTIVE

    def ticks_to(self, error: float) -> int:
        """Ticks until |e| is below `error` [m]."""
        assert self.error[-1] < error
        return int(np.argmax(self.error < error))


def controller_for(description: RobotDescription, name: str, **parameters: object) -> Controller:
    content = {"controller": name, "parameters": parameters}
    made: Controller = build(parse(ControllerConfig, content, "test"), description)
    made.now = lambda: 0
    return made


@cache
def run(
    name: str = "qp12",
    ticks: int = 401,
    until: float = 0.0,
    usable_limits: bool = False,
    plant: tuple[tuple[str, object], ...] = (),
    **parameters: object,
) -> Run:
    """The motion, until |e| < `until` [m] or for that many ticks; `plant` are its settings."""
    description = HOAP3 if usable_limits else HOAP3_TO_ITS_STOPS
    controller = controller_for(description, name, **parameters)
    body = Body(description, **dict(plant))
    controller.reset(body.state, None)
    rows = []
    for _ in range(ticks):
        state, command = body.state, controller.step(body.state)
        u = (command.values - state.reference) / PERIOD
        certificate = command.v, command.v_rate_predicted, command.solver_status
        rows.append((*certificate, u, state.q.copy(), state.reference.copy()))
        if command.v < until**2 / 2:
            break
        body.follow(command.values)
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))
