"""What a controller's log holds, as tables: each State that it processed, and its answers.

A log may hold several engagements: each time the controller met a robot it recorded description
and session anew. Each becomes a `ControllerRun`; nothing is carried from one to the next.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, Message, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.disk_rows import DiskRows, RowsAt

Rows = NDArray[Any]
EVENTS = Event.schema.constants


@dataclass
class ControllerRun:
    """One engagement of a controller with a robot.

    Attributes:
        description: of the robot.
        session: what the controller recorded at its begin: `lockstep`, `extra` (names of the
            columns of Setpoint.extra), `conditions`, …
        resets: how many States had been processed at each reset that is recorded, ascending: the
            State with that place is the first after it.
        gaps: places of States before which records are missing from the log.
        overwritten: how many States the controller says it never saw, by the place of the next.
        epochs: (how many States were processed before it, epoch) of each authority.
        conditions: (place of the State, number, whether it began) of each condition that began or
            ended, in their order.
        strange: messages that no State or Setpoint of this robot can be.
        orphans: answers to States that are missing from the log.
    """

    description: RobotDescription
    session: dict[str, Any]
    resets: list[int] = field(default_factory=list)
    gaps: list[int] = field(default_factory=list)
    overwritten: dict[int, int] = field(default_factory=dict)
    epochs: list[tuple[int, int]] = field(default_factory=list)
    conditions: list[tuple[int, int, bool]] = field(default_factory=list)
    strange: int = 0
    orphans: int = 0
    _states: DiskRows = field(default_factory=DiskRows)
    _answers: DiskRows = field(default_factory=DiskRows)
    _answered: array[int] = field(default_factory=lambda: array("q"))
    _forms: dict[type[Message], Message] = field(default_factory=dict)

    @cached_property
    def states(self) -> Rows:
        """Every State that was processed, in that order, as a structured array on disk."""
        return as_table(State, self._states)

    @cached_property
    def answers(self) -> RowsAt:
        """Every Setpoint that was sent, likewise; those of one layout."""
        return RowsAt.of(as_table(Setpoint, self._answers))

    @cached_property
    def answered(self) -> NDArray[np.int64]:
        """For each answer the place of its State in `states`, (N,)."""
        return np.array(self._answered, np.int64)

    @property
    def answered_states(self) -> RowsAt:
        """The State of each answer, (N,)."""
        return RowsAt(self.states, self.answered)

    @property
    def remembered(self) -> NDArray[np.bool_]:
        """For each answer whether the log has all since the controller last began anew, (N,)."""
        reset, gap = (last_of(places, self.answered) for places in (self.resets, self.gaps))
        return (reset >= 0) & (reset >= gap)

    def during(self, begin: str) -> NDArray[np.bool_]:
        """For each answer whether a condition with such a begin held, as logged, (N,)."""
        names = self.session.get("conditions") or ()
        held, found, start = set[int](), np.zeros(len(self.states), bool), 0
        ends = ((gap, -1, False) for gap in self.gaps)  # conditions are unknown there
        for place, number, began in sorted([*self.conditions, *ends], key=lambda each: each[0]):
            found[start:place] = bool(held)
            start = place
            if number < 0:
                held.clear()
            elif number < len(names) and str(names[number]).startswith(begin):
                (held.add if began else held.discard)(number)
        found[start:] = bool(held)
        return np.asarray(found[self.answered])

    def only(self, answers: NDArray[np.bool_] | slice) -> ControllerRun:
        """The same with some of its answers, by a mask (N,) or a slice."""
        part = replace(self)
        part.__dict__["states"] = self.states  # which are many, and the same
        part.__dict__["answers"] = self.answers[answers]
        part.__dict__["answered"] = self.answered[answers]
        return part


def runs(records: Iterable[Record]) -> Iterator[ControllerRun]:
    """The engagements in a controller's log, in their order."""
    description: RobotDescription | None = None
    run: ControllerRun | None = None
    for kind, _, payload in records:
        if kind == Kind.DESCRIPTION:
            description = RobotDescription.from_json(payload)
        elif kind == Kind.SESSION and description is not None:
            if run is not None:
                yield run
            run = ControllerRun(description, json.loads(payload))
        elif run is not None:
            _add(run, kind, payload)
    if run is not None:
        yield run


def _add(run: ControllerRun, kind: Kind, payload: bytes) -> None:
    if kind == Kind.STATE:
        _add_state(run, payload)
    elif kind == Kind.SETPOINT:
        _add_answer(run, payload)
    elif kind == Kind.EVENT:
        event, detail = Event.scalars(payload, "kind", "detail")
        missing = run.gaps[-1:] == [len(run._states)]  # the State that it belongs to is not here
        if event == EVENTS["RESET"]:
            if not missing:
                run.resets.append(max(0, len(run._states) - 1))
        elif event == EVENTS["OVERWRITTEN"]:
            run.overwritten[len(run._states)] = detail
        elif event in {EVENTS["CONDITION_BEGAN"], EVENTS["CONDITION_ENDED"]}:
            began = event == EVENTS["CONDITION_BEGAN"]
            place = max(0, len(run._states) - (not missing))
            run.conditions.append((place, detail, began))
    elif kind == Kind.AUTHORITY:
        run.epochs.append((len(run._states), int(json.loads(payload)["epoch"])))
    elif kind == Kind.GAP:
        run.gaps.append(len(run._states))


def _add_state(run: ControllerRun, payload: bytes) -> None:
    if _fits(State, payload, run._forms, q=run.description.n):
        run._states.add(payload)
    else:
        run.strange += 1


def _add_answer(run: ControllerRun, payload: bytes) -> None:
    if run.gaps[-1:] == [len(run._states)]:
        run.orphans += 1
    elif _fits(Setpoint, payload, run._forms, values=run.description.n) and run._states:
        run._answers.add(payload)
        run._answered.append(len(run._states) - 1)
    else:
        run.strange += 1


def last_of(places: list[int], at: NDArray[np.int64]) -> NDArray[np.int64]:
    """The last of ascending places that is not behind each of `at`; -1 where there is none."""
    known = np.array([-1, *places], np.int64)
    return known[np.searchsorted(known, at, "right") - 1]


def _fits(
    message: type[State] | type[Setpoint],
    payload: bytes,
    forms: dict[type[Message], Message],
    **lengths: int,
) -> bool:
    """Whether it is a message with these array lengths, and of the layout of those before it."""
    form = forms.get(message)
    try:
        if form is None:
            form = message.like(payload)
        form.load(payload)
    except WireError:
        return False
    if message not in forms and form.lengths.items() >= lengths.items():
        forms[message] = form
    return message in forms


def as_table(message: type[State] | type[Setpoint], rows: DiskRows) -> Rows:
    """Messages of one layout as a structured array.

    Raises:
        ValueError: they are of several.
    """
    schema = message.schema
    if not rows:
        return np.zeros(0, schema.dtype(dict.fromkeys(schema.arrays, 0)))
    first = rows.raw[: rows.sizes[0]].tobytes()
    return rows.table(schema.dtype(schema.lengths_in(first)))
