"""Tasks and constraints of users: their own code at the States of a log.

Nothing else can say what their errors and margins mean, so these are taken from the code itself.
Its derivatives are compared with central differences of them, in every cycle that is checked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.config.plugins import blame, building
from hoap3.protocol.errors import UsageError
from hoap3.remote_controller.constraints import limit_reference
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.problems import statement
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    Constraint,
    Level,
    Rows,
    fitted_rate,
    sides,
)
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks import task_oracle
from hoap3.remote_controller.problems.statement import Claim
from hoap3.remote_controller.tasks import registry as tasks

if TYPE_CHECKING:
    from hoap3.remote_controller.model.kinematics import Kinematics

Array = NDArray[np.float64]

STEP = 1e-6  # rad, m or s: rounding and curvature both stay far below the tolerance
TOLERANCE = 1e-4  # of the largest derivative
ROUNDING = 1e-14  # of a value, or of 1: what a difference of two such values rounds
ASIDE = 1e-5  # rad or m: how far the fastest joint is moved for −m̈
AT_REST = 1e-9  # rad/s or m/s: no joint moves
BENT = 1e-9  # of |∇m|·|q̇|²: how exactly −m̈ is known by differences


class PlainKinematics:
    """The `Kinematics` that users' code is called with, by Pinocchio's own functions.

    Args:
        robot: that is placed.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.n = robot.description.n

    def frame_id(self, frame: str) -> int:
        """As of `Kinematics`."""
        return int(self._robot.model.getFrameId(self._robot.known(frame)))

    def update(self, q: Array) -> None:
        """As of `Kinematics`."""
        self._robot.place(q)

    def joints(self, position_out: Array) -> None:
        """As of `Kinematics`."""
        position_out[:] = self._robot.positions

    def com(self, frame: int, position_out: Array, jacobian_out: Array) -> None:
        """As of `Kinematics`."""
        position_out[:], jacobian_out[:] = self._robot.com(self._name(frame))

    def frame(
        self,
        frame: int,
        reference: int,
        position_out: Array,
        rotation_out: Array,
        jacobian_out: Array,
    ) -> None:
        """As of `Kinematics`."""
        found = self._robot.frame(self._name(frame), self._name(reference))
        position_out[:], rotation_out[:], jacobian_out[:] = found

    def _name(self, frame: int) -> str:
        return str(self._robot.model.frames[frame].name)


def plain_kinematics(robot: Robot) -> Kinematics:
    """What users' code is given for its `Kinematics`."""
    return cast("Kinematics", PlainKinematics(robot))


class UserTask(task_oracle.ErrorTask):
    """A task with an error, of a user's class.

    Args:
        entry: of the config.
        robot: that it is for.

    Raises:
        UnverifiableError: the class cannot be imported or built, or gives V without an error.
    """

    def __init__(self, entry: Mapping[str, Any], robot: Robot) -> None:
        self._name = str(entry["task"])
        self._kinematics = plain_kinematics(robot)
        with _of_users(self._name):
            given = {"task": self._name, "parameters": dict(entry.get("parameters") or {})}
            settings = tasks.TaskSettings.model_validate(given)
            level = tasks.find(self._name).levels[0]
            robot_of = robot.description
            self._function = tasks.build(settings, robot_of, self._kinematics, level=level)
            rows, jacobian, _ = self._function.followed
            if not len(rows) or jacobian is not self._function.jacobian:
                raise UnverifiableError(f"task {self._name:.60} is not an error e with V = ½|e|²")
        self.roots = np.ones(len(rows))
        self._at: tuple[Array, float] | None = None
        self._size = 1.0

    @property
    def rounding(self) -> float:
        """How much rounding of joint positions changes the error."""
        return self._size

    def begin(self, robot: Robot, time_s: float) -> None:
        """Reset the task where the robot is."""
        del robot
        with _of_users(self._name):
            self._function.reset(self._kinematics, time_s)

    def take_over(self, other: object) -> None:
        """Keep the instance, and so what it stored at its reset, with other parameters."""
        if isinstance(other, UserTask):
            parameters = self._function.parameters
            self._function, self._kinematics = other._function, other._kinematics
            with _of_users(self._name):
                self._function.apply(parameters)
                self._function.parameters = parameters

    def at(self, robot: Robot, time_s: float) -> task_oracle.Rows:
        """Evaluate the error and its derivatives, as the class gives them."""
        self._at = robot.positions.copy(), time_s
        e, J, rate = self._evaluate(time_s)
        self._size = 1.0 + float(np.abs(J).sum(axis=1).max(initial=np.abs(e).max()))
        return task_oracle.Rows(e, J, rate)

    def error_at(self, robot: Robot, time_s: float) -> Array:
        """Evaluate the error; the class computes its Jacobian at the same time."""
        robot.place(robot.positions)
        return self._evaluate(time_s)[0]

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """Claims that ∂e/∂q and ∂e/∂t are those of e, where `at` was called last."""
        if self._at is None:
            return []
        q, time_s = self._at

        def error(place: Array, at_s: float) -> Array:
            robot.place(place)
            return self._evaluate(at_s)[0]

        robot.place(q)
        e, J, rate = self._evaluate(time_s)
        quotients, doubt = _differences(lambda place: error(place, time_s), q, e)
        ahead, behind = error(q, time_s + STEP), error(q, time_s - STEP)
        in_time, doubt_in_time = _quotient(ahead, behind, e)
        return [
            _worst(f"∂e/∂q of task {self._name:.40}", J, quotients, doubt),
            _worst(f"∂e/∂t of task {self._name:.40}", rate, in_time, doubt_in_time),
        ]

    def moved(self, robot: Robot) -> task_oracle.Flags:
        """All joints may."""
        return np.ones(robot.description.n, bool)

    def _evaluate(self, time_s: float) -> tuple[Array, Array, Array]:
        with _of_users(self._name):
            self._function.update(self._kinematics, time_s)
            e, J, rate = (np.array(each, float) for each in self._function.followed)
        return e, J, rate


OWN_ROWS: Mapping[Level, tuple[str, ...]] = {
    "velocity": ("update",),
    "acceleration": ("update_accelerations", "bound_accelerations"),
}
"""Methods by which a user's constraint has other rows than those of its margins."""


class UserBarrier(Constraint):
    """Margins m(q) ≥ 0 of a user's `Barrier`, kept by (25): −∇m·u ≤ η·m.

    Args:
        name, given: of the entry in a config, and its parameters.
        robot: that it is for.
        level: of its rows.

    Raises:
        UnverifiableError: the class cannot be imported or built, or writes rows of its own.
    """

    has_rows: ClassVar[bool] = True
    yields: ClassVar[bool] = True

    def __init__(self, name: str, given: object, robot: Robot, level: Level = "velocity") -> None:
        super().__init__({}, robot.description, robot)
        self.name, self._kinematics = name, plain_kinematics(robot)
        self._at: Array | None = None
        with _of_users(name):
            entry = constraints.ConstraintSettings.model_validate(
                {"constraint": name, "parameters": given or {}}
            )
            (read,) = constraints.read([entry])
            build: Any = read.constraint
            own = OWN_ROWS[level]
            if not issubclass(build, Barrier) or any(
                getattr(build, name) is not getattr(Barrier, name) for name in own
            ):
                raise UnverifiableError("it writes rows of its own, which are not recomputed")
            parameters: Any = read.parameters
            keys = "config", f"{read.key}.constraint", f"{read.key}.parameters"
            robot_of = robot.description
            with building(build, name, robot_of, parameters, *keys):
                made = build(parameters, robot_of, self._kinematics, robot_of.period_s)
        self._barrier: Barrier = made
        self.is_conditional = made.guarantee == "conditional"
        for limit in ("speed_max", "acceleration_max", "torque_max"):
            if getattr(made, limit) is not None:
                setattr(self, limit, np.array(getattr(made, limit)))
        self._numbers = (
            parameters.eta_per_s,
            parameters.reserve_m,
            parameters.return_speed_m_s,
        )

    def begin(self, state: Any) -> None:
        """Reset the barrier where the robot is."""
        del state
        with _of_users(self.name):
            self._barrier.reset()
            self._barrier.begin(self._kinematics)

    def take_over(self, other: Constraint) -> None:
        """Keep the instance, and so what it stored when it began, with other parameters."""
        if isinstance(other, UserBarrier):
            parameters = self._barrier.parameters
            self._barrier, self._kinematics = other._barrier, other._kinematics
            with _of_users(self.name):
                self._barrier.apply(parameters)
                self._barrier.parameters = parameters

    def rows(self, state: Any, number: int) -> Rows:
        """(25) for each margin."""
        del state
        self._at = self.robot.positions.copy()
        m, A = self._look()
        self.amplifies = 1.0 + float(np.abs(A).sum(axis=1).max(initial=0.0))
        self.margins[number] = m.min(initial=np.inf)
        A, b = limit_reference.rows(m, A, *self._numbers)
        return Rows(A, b, np.ones(len(b), bool))

    def fit(self, speed: Array, brake: Array) -> None:
        """Lower η to what joints can brake with."""
        with _of_users(self.name):
            self._barrier.prepare_accelerations(speed, brake)
        self._eta = fitted_rate(self._numbers[0], self.description.period_s, speed, brake)

    def acceleration_rows(self, dq: Array) -> statement.Rows:
        """(25) once more; −m̈ by differences of ∇m, whatever `bend` returns."""
        self._at = q = self.robot.positions.copy()
        self.margins, A = self._look()
        m = self.margins
        fastest, bend, doubt = float(np.abs(dq).max()), np.zeros(len(m)), 0.0
        if fastest > AT_REST:
            aside = ASIDE / fastest * dq
            found = []
            for place in (q + aside, q - aside):
                self.robot.place(place)
                found.append(self._look()[1] @ dq)
            self.robot.place(q)
            bend = (found[0] - found[1]) * fastest / (2.0 * ASIDE)
            doubt = BENT * (1.0 + float(np.abs(A).max(initial=0.0))) * float(np.abs(dq).sum()) ** 2
        given = self._eta, *self._numbers[1:]
        A, upper = limit_reference.accelerations(m, A, dq, bend, *given)
        return sides(A, -np.inf, upper, dq, self._eta, doubt)

    def margins_here(self) -> Array:
        """Return m."""
        return self._look()[0]

    def derivative_claims(self) -> list[Claim]:
        """Claims that −∇m is that of m, where rows were computed last."""
        if self._at is None:
            return []

        def margins(place: Array) -> Array:
            self.robot.place(place)
            return self._look()[0]

        self.robot.place(self._at)
        m, A = self._look()
        known = np.isfinite(m)
        quotients, doubt = _differences(margins, self._at, m)
        name = f"∇m of constraint {self.name:.40}"
        return [_worst(name, -A[known], quotients[known], doubt[known])] if known.any() else []

    def _look(self) -> tuple[Array, Array]:
        rows, n = self._barrier.rows, self.description.n
        m, A = np.full(rows, np.inf), np.zeros((rows, n))
        with _of_users(self.name):
            self._barrier.look(self._kinematics, m, A)
        return m, A


@contextmanager
def _of_users(name: str) -> Iterator[None]:
    """Turn whatever a user's code raises into the reason why it is not verified."""
    try:
        yield
    except UnverifiableError:
        raise
    except UsageError as error:
        raise UnverifiableError(f"{error!s:.240}") from error
    except (Exception, SystemExit) as error:  # it must not end the verification
        raise UnverifiableError(f"{name:.60}: {blame(error)}") from error


def _differences(value: Callable[[Array], Array], q: Array, here: Array) -> tuple[Array, Array]:
    """Central differences of a function of joint positions, (m, n), and how exact they are."""
    shifts = STEP * np.eye(len(q))
    ahead = np.array([value(q + shift) for shift in shifts]).T
    behind = np.array([value(q - shift) for shift in shifts]).T
    return _quotient(ahead, behind, here[:, None])


def _quotient(ahead: Array, behind: Array, here: Array) -> tuple[Array, Array]:
    """A central difference, and how exact it is: by its curvature and its rounding."""
    quotient = (ahead - behind) / (2.0 * STEP)
    bend = np.abs(ahead - 2.0 * here + behind) / (2.0 * STEP)
    return quotient, bend + ROUNDING * np.maximum(np.abs(here), 1.0) / STEP + 0.0 * quotient


def _worst(name: str, stated: Array, value: Array, doubt: Array) -> Claim:
    """The claim of that derivative which differs most from its difference quotient."""
    error = TOLERANCE * float(np.abs(value).max(initial=0.0)) + doubt
    off = np.abs(stated - value) / error
    at = np.unravel_index(int(np.argmax(np.where(np.isnan(off), np.inf, off))), off.shape)
    return Claim(name, float(stated[at]), float(value[at]), float(error[at]))
