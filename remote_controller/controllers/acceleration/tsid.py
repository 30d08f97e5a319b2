"""Task-space inverse dynamics for torque-controlled robots (Del Prete, IEEE RA-L 2018)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from hoap3.protocol.errors import located
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration import tsid_settings as settings
from hoap3.remote_controller.controllers.acceleration.base import FALLBACKS
from hoap3.remote_controller.controllers.acceleration.joint_bounds import NO_BOUND
from hoap3.remote_controller.controllers.acceleration.weighted import WeighedController
from hoap3.remote_controller.scheduling.weights import Weights
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import Tsid
from hoap3.remote_controller.tasks.registry import labels_of

OF_GOAL = frozenset({"tolerance_m", "tolerance_deg", "task.kp", "task.kd"})
"""Numbers without effect where there are tasks."""
REST_OF_FREE = 1e-2  # of the posture's weight: that of what neither tasks nor posture determine
LEAST_WEIGHT = 1e-9  # of the posture: without any the accelerations are not determined


class TsidController(WeighedController):
    """Tasks, such as a frame to a pose in SE(3), and a posture in their null space: (33) and (34).

        min Σ ω_i |J_i ddq − b_i|² + w·|ddq_p − ddq|²
        such that lower ≤ ddq ≤ upper, |M·ddq + h| ≤ effort, and what `constraints` ask for

    b_i is what task i asks for less its drift; of a pose ν̇_d − J̇·dq with ν̇_d = kp·log(H⁻¹H_d) −
    kd·ν, in the frame's axes. The posture is the last of the tasks, and called `rest`:
    ddq_p = kp·(q_r − q) − kd·dq.

    Where the efforts are too small for the bounds, these are kept, the efforts violated as little
    as possible, and `fallback` is 2; 3 where the solver gave up, and ddq is that of the posture,
    cut to the bounds.

    Raises:
        ConfigError: a task, a goal, a posture or bounds that do not fit the robot.
    """

    Parameters: ClassVar[Any] = settings.Parameters
    proves = True
    _roots: FloatArray | None  # of the weights, (m, 1), where these are not all 1

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        super().__init__(description, settings.with_all_tasks(description, parameters), file)
        self.parameters = parameters  # as a change of them is written
        count = len(parameters.tasks or ())
        self.fixed = OF_GOAL if count else frozenset()
        self.parts = [
            part for part in self.parts if part.place[0] != "tasks" or int(part.place[1]) < count
        ]
        given, free = self.problem, parameters.base == "free"
        torque_max = np.full(description.n, NO_BOUND) if free else self.torque_max
        self.solver = Tsid(torque_max, len(given.rows))
        self.answer_in(self.solver.ddq, self.solver.tau)
        m = len(given.wanted) if free else self.tasks.rows[-1].start
        self._sizes = self.tasks.sizes if free else self.tasks.sizes[:-1]
        self._jacobian, self._wanted = given.jacobian[:m], given.wanted[:m]
        self._rest = given.towards if free else given.wanted[m:]
        self._weighed = np.zeros_like(self._jacobian), np.zeros(m)
        self._found = status.OK

    def apply(self, parameters: Any) -> None:
        """Read the gains of the tasks, or of the goal, and of the posture; the greatest speed."""
        self.tasks.gain([*(parameters.tasks or [parameters.task]), parameters.posture])
        if parameters.tasks is None:
            self.tasks.tolerate(0, parameters.tolerance_m, parameters.tolerance_deg)
        self.bounds.apply(parameters.bounds)

    @classmethod
    def importance_of(cls, parameters: Any) -> Weights:
        """The weights, that of the posture last.

        Raises:
            ConfigError: they do not fit the tasks.
        """
        names = labels_of(parameters.tasks) if parameters.tasks else [settings.POSE]
        names = names if settings.REST in names else [*names, settings.REST]
        with located("", "priorities"):
            return Weights(names, settings.weights_of(parameters))

    def count(self, out: FloatArray) -> None:
        """Write the weights; V is that of the tasks, without the posture."""
        super().count(out)
        self.tops[-1] = False
        weights = self.importance.value
        self._weight = max(float(weights[-1]), LEAST_WEIGHT)
        if self._free is not None:  # the posture is not the unknown, but a task like the others
            self._weight *= REST_OF_FREE
        weighed = weights[: len(self._sizes)]
        self._roots = None
        if (weighed != 1.0).any():
            self._roots = np.repeat(np.sqrt(weighed), self._sizes)[:, None]

    def solve(self, torque_max: FloatArray) -> bool:
        """One quadratic program of all."""
        del torque_max  # those that the solver was made with
        given, solver = self.problem, self.solver
        if len(given.rows):
            solver.rows[:] = given.rows
            solver.rows_lower[:], solver.rows_upper[:] = given.rows_lower, given.rows_upper
        jacobian, wanted = self._jacobian, self._wanted
        if self._roots is not None:
            jacobian, wanted = self._weighed
            np.multiply(self._jacobian, self._roots, out=jacobian)
            np.multiply(self._wanted, self._roots[:, 0], out=wanted)
        self._found = solver.solve(
            jacobian,
            wanted,
            self._weight,
            self._rest,
            given.mass,
            given.bias,
            given.lower,
            given.upper,
        )
        self.residual = solver.kkt_residual
        return self._found == status.OK

    def fall_back(self, dq: FloatArray) -> int:
        """What the solver found instead, which `solve` has written already."""
        del dq
        return FALLBACKS[self._found]
