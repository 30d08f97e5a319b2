"""What a controller remembers of its run, from the events of its log."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, Message, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.statement import Claim, Statement
from hoap3.remote_controller.problems.velocity_answer import DELAYED, VelocityAnswer

if TYPE_CHECKING:
    from hoap3.remote_controller.problems.parameters_in_force import ParametersInForce

EVENTS = Event.schema.constants
OF_PRIORITIES = frozenset({"set", "order", "insert", "remove", "weights"})
"""Keys of requests for other priorities."""
HELD_BACK = "a change is held back"
"""The condition under which changes wait."""
FINITE = ("q", "reference")
"""Fields of a State without which a cycle cannot be repeated."""
_Layout = tuple[tuple[int, ...], np.dtype[Any]]


class History:
    """The States, resets, targets, conditions and changes of a run, up to the newest State.

    Args:
        description: of the robot.
        session: what the controller recorded at its begin: `targets`, `conditions`, `extra`, …

    Attributes:
        description, session: as given.
        messages: of live targets.
        state: the newest State, as a row of its structured array; None before the first.
        last: the finite State before it.
        before: the newest State of an earlier period since the last reset; None where there is
            none.
        answer, last_answer: the answers to `state` and `last`, as rows; None where there is none.
        first: the first finite State since the last reset.
        finite: whether `state` can be computed with.
        fresh: whether `state` is `first`.
        was_reset: whether the controller was reset at `state`.
        known: whether the log has everything since the last reset.
        conditions: texts of those that hold.
        requests: for other priorities, which a builder has not processed yet.
        states, rejected: how many States there were, and how many of other layouts.
        needed: fields of a State without which a cycle cannot be repeated.
        accepts: whether a State of finite numbers can be computed with.
    """

    def __init__(self, description: RobotDescription, session: Mapping[str, Any]) -> None:
        from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Messages

        self.description, self.session = description, session
        self.messages = Messages(names=session.get("targets") or ())
        self.state: Any = None
        self.last: Any = None
        self.answer: Any = None
        self.last_answer: Any = None
        self.before: Any = None
        self.first: Any = None
        self.finite = self.fresh = self.known = self.was_reset = False
        self.conditions: set[str] = set()
        self.requests: list[dict[str, Any]] = []
        self.states, self.rejected = 0, 0
        self._reset_at: Any = None
        self.needed: tuple[str, ...] = FINITE
        self.accepts: Callable[[Any], bool] = lambda _: True
        self._gap = self._skips_answers = False
        self._layouts: dict[type[Message], _Layout] = {}  # of the newest message

    @property
    def time_s(self) -> float:
        """Of the newest State [s]."""
        return int(self.state["tick"]) * self.description.period_s

    def share_of_ramp(self, ramp_s: float) -> float:
        """Share of Ψ at the newest State: it rises in a time [s], from the State of the reset."""
        ticks = ramp_s / self.description.period_s
        done = max(self.periods_between(self._reset_at, self.state) + 1.0, 1.0)
        return 1.0 if done >= ticks else done / ticks

    def periods_between(self, earlier: Any, later: Any) -> int:
        """Periods of the robot between two States, without those that it skipped."""
        passed = int(later["tick"]) - int(later["skipped"])
        return passed - (int(earlier["tick"]) - int(earlier["skipped"]))

    def parse(self, message: type[State] | type[Setpoint], payload: bytes) -> Any | None:
        """A message as a row; None where it is not one of this run."""
        known = self._layouts.get(message)
        if known is None or not message.schema.fits(payload, known[0]):
            known = self._layout_of(message, payload)
            if known is None:
                return None
            self._layouts[message] = known
        return np.frombuffer(payload, known[1])[0]

    def _layout_of(self, message: type[Message], payload: bytes) -> _Layout | None:
        """Lengths of a message's arrays, and its layout; None where it is not one of this run."""
        try:
            sizes = message.schema.lengths_in(payload)
        except WireError:
            return None
        if sizes["q" if message is State else "values"] != self.description.n:
            return None
        if message is Setpoint and sizes["extra"] != len(self.session.get("extra") or ()):
            return None
        return tuple(sizes.values()), message.schema.dtype(sizes)

    def take_state(self, state: Any) -> None:
        """Make a State the newest one."""
        self.states += 1
        last = self.state
        if last is not None and self.finite:
            self.last, self.last_answer = last, self.answer
            if self.first is not None and self.periods_between(last, state) > 0:
                self.before = last
        self.answer, self._skips_answers = None, False
        self.state, self.finite = state, is_finite(state, *self.needed) and self.accepts(state)
        self.fresh = self.was_reset = self._gap = False
        if self._reset_at is None:  # reset before its first State
            self._reset_at = state
        if self.first is None and self.finite:
            self.first, self.fresh = state, True

    def reject_state(self) -> None:
        """Count a State that is none of this robot's; what follows is no answer to a known one."""
        self.rejected += 1
        self.answer, self._skips_answers = None, True

    def take(self, kind: Kind, payload: bytes) -> None:
        """Fold any other record."""
        if kind == Kind.SETPOINT:
            self.answer = None if self._skips_answers else self.parse(Setpoint, payload)
        elif kind == Kind.EVENT:
            self._take_event(*Event.scalars(payload, "kind", "detail"))
        elif kind == Kind.TARGET:
            self._take_target(payload)
        elif kind == Kind.CHANGE:
            request = json.loads(payload)
            if not OF_PRIORITIES.isdisjoint(request):
                self.requests.append(request)
        elif kind == Kind.GAP:
            self._gap, self.known, self._skips_answers = True, False, True
            self.first = self.before = self.last = self.last_answer = self.answer = None
            self.conditions.clear()

    def _take_event(self, event: int, detail: int) -> None:
        if event == EVENTS["RESET"] and not self._gap:
            self.known, self.was_reset, self.before, self.first = True, True, None, None
            self._reset_at = self.state
            if self.state is not None and self.finite:
                self.first, self.fresh = self.state, True
        elif event in {EVENTS["CONDITION_BEGAN"], EVENTS["CONDITION_ENDED"]}:
            names = self.session.get("conditions") or ()
            if detail < len(names):
                began = event == EVENTS["CONDITION_BEGAN"]
                (self.conditions.add if began else self.conditions.discard)(str(names[detail]))

    def _take_target(self, payload: bytes) -> None:
        from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Taken

        tick = -1 if self.state is None else int(self.state["tick"])
        self.messages.add(Taken.of(payload, tick, self.description.period_s))


class ProblemBuilder(ABC):
    """States the problem of each answer in a controller's log.

    A builder runs no controller and calls no kernel. It sees every record of the log, in its
    order; problems may be asked for only some of the answers.

    Args:
        description: of the robot.
        parameters: of the controller, as the log's configuration gives them.
        session: what the controller recorded at its begin.
        controller: its registered name, for the defaults of what is changed while it runs.

    Raises:
        UnverifiableError: something in the configuration cannot be recomputed.
    """

    checks_every_answer: ClassVar[bool] = False
    """Whether a problem takes a millisecond or less, so that by default each answer is checked."""

    def __init__(
        self,
        description: RobotDescription,
        parameters: Mapping[str, Any],
        session: Mapping[str, Any],
        controller: str,
    ) -> None:
        self.history = History(description, session)
        self._open = False  # the newest State waits for its event of a reset
        self._controller, self._given = controller, parameters
        self._in_force: ParametersInForce | None = None
        self._values: Mapping[Any, Any] = {}

    @abstractmethod
    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take other parameters from the newest State on; all that is remembered stays."""

    def restart(self) -> None:  # noqa: B027 - many remember nothing
        """The controller was reset at the newest State, which need not be finite."""

    def begin(self) -> None:  # noqa: B027 - as above
        """Forget everything: the newest State is the first after a reset."""

    def observe(self) -> None:  # noqa: B027 - as above
        """Process the newest State, which is finite; of the first one `begin` was called before."""

    @abstractmethod
    def state_problem(self, setpoint: Any) -> Statement:
        """The problem of an answer to the newest State.

        Args:
            setpoint: as a row of its structured array; its values are finite.
        """

    def feed(self, kind: Kind, payload: bytes) -> None:
        """Take a record of the log."""
        if kind == Kind.STATE:
            self._close()
            state = self.history.parse(State, payload)
            if state is None:
                self.history.reject_state()
                return
            self.history.take_state(state)
            self._open = True
            return
        if kind == Kind.CHANGE:
            self._close()
            self._ask(json.loads(payload))
        self.history.take(kind, payload)

    @property
    def has_memory(self) -> bool:
        """Whether `observe` must see each State, not only those whose problems are asked for."""
        return type(self).observe is not ProblemBuilder.observe

    def problem(self) -> Statement | None:
        """The problem of the newest answer; None where the log lacks what it depends on."""
        self._close(asked=True)
        history, setpoint = self.history, self.history.answer
        if setpoint is None or not (history.known and history.finite):
            return None
        finite = is_finite(setpoint, "values", "decision")
        if not finite:
            return None
        statement, more = self.state_problem(setpoint), self.derivative_claims()
        return replace(statement, claims=(*statement.claims, *more)) if more else statement

    def derivative_claims(self) -> list[Claim]:
        """Claims that derivatives in users' tasks and constraints are right, of this problem."""
        return []

    def velocity_answer(self, setpoint: Any) -> VelocityAnswer:
        """The joint velocities of an answer to the newest State, (n,) [rad/s or m/s].

        Args:
            setpoint: as for `state_problem`.

        Raises:
            UnverifiableError: the robot applies answers later, so its start is not in the log.
        """
        history = self.history
        if history.description.delay_ticks:
            raise UnverifiableError(DELAYED)
        period_s = history.description.period_s
        return VelocityAnswer.of(history.state, setpoint, self._given, period_s)

    def _close(self, *, asked: bool = False) -> None:
        """Process the newest State, once it is known whether the controller was reset at it."""
        history, waiting = self.history, self._open
        self._open = False
        if waiting and history.was_reset:
            self.restart()
        if waiting and self._in_force is not None:
            self._follow(self._in_force)
        if waiting and history.known and history.finite:
            if history.fresh:
                self.begin()
            if asked or self.has_memory:
                self.observe()

    def _ask(self, request: Mapping[str, Any]) -> None:
        """Take a request for other parameters; priorities are the builders' own."""
        if not OF_PRIORITIES.isdisjoint(request):
            return
        if self._in_force is None:
            from hoap3.remote_controller.problems.parameters_in_force import ParametersInForce

            self._in_force = ParametersInForce(
                self._controller, self.history.description, self._given
            )
        self._in_force.ask(request)

    def _follow(self, in_force: ParametersInForce) -> None:
        """Adopt what is in force at the newest State."""
        if self.history.was_reset:
            in_force.reset()
        held = HELD_BACK in self.history.conditions
        in_force.advance(int(self.history.state["tick"]), held=held)
        if in_force.values != self._values:
            self._values = in_force.values
            self.adopt(in_force.parameters())


def is_finite(row: Any, *names: str) -> bool:
    """Whether fields of a row hold only finite numbers."""
    return all(bool(np.isfinite(row[name]).all()) for name in names)
