"""Parameters that were changed while a controller ran, and the parts of a run with each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.history import HELD_BACK, OF_PRIORITIES
from hoap3.remote_controller.problems.parameters_in_force import (
    OF_CHANGES,
    Parameters,
    ParametersInForce,
    Place,
)
from hoap3.tools.verify.controller_log import ControllerRun

WHOLE = frozenset({"stable_qp"})
"""Controllers whose answers follow from those before: a part of a run cannot be judged alone."""


def with_numbers(
    run: ControllerRun, controller: str, parameters: Mapping[str, Any]
) -> Iterator[tuple[ControllerRun, Parameters]]:
    """The parts of a run with the parameters that each was answered with.

    Args:
        run: whose changes of priorities stay in its parts.
        controller: its registered name.
        parameters: of the log's config.

    Raises:
        LookupError, ValueError, UsageError: a change that no controller has taken.
    """
    given = {key: value for key, value in parameters.items() if key not in OF_CHANGES}
    asked = [each for each in run.changes if OF_PRIORITIES.isdisjoint(each[1])]
    if not asked:
        yield run, given
        return
    others = [each for each in run.changes if not OF_PRIORITIES.isdisjoint(each[1])]
    run = replace(run, changes=others)
    followed = ParametersInForce(controller, run.description, parameters)
    found = _at_each_state(followed, run, asked)
    if controller in WHOLE:
        yield replace(run, in_force=_with_each(followed, found)), given
        return
    at_answers = [found[place] for place in run.answered.tolist()]
    first = 0
    while first < len(at_answers):
        end = first + 1
        while end < len(at_answers) and at_answers[end] == at_answers[first]:
            end += 1
        which = np.zeros(len(at_answers), bool)
        which[first:end] = True
        yield run.only(which), followed.parameters(at_answers[first])
        first = end


def _at_each_state(
    followed: ParametersInForce, run: ControllerRun, asked: list[tuple[int, dict[str, Any]]]
) -> list[dict[Place, Any]]:
    """What is no longer that of the config, at each State."""
    held, resets, waiting, found = _held(run), {*run.resets}, [*asked], []
    for place, tick in enumerate(run.states["tick"].tolist()):
        while waiting and waiting[0][0] <= place:
            followed.ask(waiting.pop(0)[1])
        if place in resets:
            followed.reset()
        followed.advance(tick, held=held[place])
        found.append(followed.values)
    return found


def _with_each(
    followed: ParametersInForce, found: list[dict[Place, Any]]
) -> list[Mapping[str, Any]]:
    """The parameters at each State; one object as long as nothing changes."""
    contents: list[Mapping[str, Any]] = []
    for i, values in enumerate(found):
        same = i > 0 and values == found[i - 1]
        contents.append(contents[-1] if same else followed.parameters(values))
    return contents


def _held(run: ControllerRun) -> list[bool]:
    """At which States numbers were held back."""
    names = list(run.session.get("conditions") or ())
    count = len(run.states)
    held = [False] * count
    if HELD_BACK not in names:
        return held
    mine = [each for each in run.conditions if each[1] == names.index(HELD_BACK)]
    ends = [*(each[0] for each in mine[1:]), count][: len(mine)]
    for (place, _, began), end in zip(mine, ends, strict=True):
        held[place:end] = [began] * (end - place)
    return held
