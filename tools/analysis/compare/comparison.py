"""Compares controllers: runs them, and computes what the table, the page and the files say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.remote_controller.tasks.registry import TaskSettings, check_parameters
from hoap3.tools.analysis.compare.candidates import Candidate, read_candidates
from hoap3.tools.analysis.compare.figures import Figures, Series, figures, findings, read_series
from hoap3.tools.analysis.compare.loops import (
    Answers,
    Say,
    closed_loop,
    open_loop,
    read_asked,
    time_answers,
)
from hoap3.tools.machine.machine import versions
from hoap3.tools.services.configs import load_emulator_config

ROBOT, DURATION_S, SEED = "hoap3", 20.0, 0
ALIKE = 0.01  # of V at the start: encoders round, and some controllers go by the reference


@dataclass(frozen=True)
class Comparison:
    """Controllers beside each other.

    Attributes:
        facts: what they were compared on: mode, robot, joints, period_s, duration_s, seed, log.
        candidates, series, figures: one each, in the order in which they were named.
        findings: what is wrong, in words.
        other_tasks: labels of those whose task is another than the first one's.
        timing: how long they take, see `loops.time_answers`; None where nobody asked.
    """

    facts: dict[str, Any]
    candidates: list[Candidate]
    series: list[Series]
    figures: list[Figures]
    findings: list[str]
    other_tasks: list[str]
    timing: dict[str, Any] | None

    @property
    def closed_loop(self) -> bool:
        """Whether answers moved robots."""
        return bool(self.facts["mode"] == "closed loop")

    @property
    def labels(self) -> list[str]:
        """What the controllers are called."""
        return [each.label for each in self.candidates]

    @property
    def notes(self) -> list[str]:
        """What to know when reading the figures, in words."""
        if not self.other_tasks:
            return []
        whose = f"{', '.join(self.other_tasks)}: another task than {self.labels[0]}"
        return [f"{whose}; V and the time to 1 % of the start cannot be compared"]

    def as_json(self) -> dict[str, Any]:
        """Everything but the times: the same in every run on the same versions."""
        return {
            **self.facts,
            "controllers": [
                {
                    "label": each.label,
                    "controller": each.config.controller,
                    "parameters": each.parameters,
                    **found,
                }
                for each, found in zip(self.candidates, self.figures, strict=True)
            ],
            "findings": self.findings,
            "other_tasks": self.other_tasks,
            "versions": versions(),
        }


def compare(
    controllers: Sequence[str],
    robot: str | None = None,
    duration: float | None = None,
    seed: int | None = None,
    log: Path | None = None,
    *,
    timing: bool = True,
    say: Say = lambda _: None,
    ready: Callable[[], None] = lambda: None,
) -> Comparison:
    """Compare controllers, in closed loop unless there is a log.

    Args:
        controllers: at least two, `[LABEL=]CONTROLLER[@KEY=VALUE,…]` each.
        robot, duration, seed: what `hoap3 run` takes; hoap3, 20 s and 0. A log has its own.
        log: answer its States instead.
        timing: whether to measure times.
        say: takes what is being done, for people.
        ready: called when all is checked, and nothing has run yet.

    Raises:
        UsageError: a controller, a setting, the robot or the log is wrong.
        Hoap3Error: a controller failed.
    """
    candidates = read_candidates(controllers)
    if log is None:
        duration = DURATION_S if duration is None else duration
        seed = SEED if seed is None else seed
        emulator, file = load_emulator_config(ROBOT if robot is None else robot, seed=seed)
        loops = [closed_loop(each, emulator, file, duration, say) for each in candidates]
    else:
        given = {"--robot": robot, "--duration": duration, "--seed": seed}
        wrong = [name for name, value in given.items() if value is not None]
        if wrong:
            raise UsageError(f"{wrong[0]}: comes from the log {log}. Drop it, or drop --log")
        description, asked = read_asked(log)
        loops = [open_loop(each, description, asked) for each in candidates]
    ready()
    answers: list[Answers] = []
    labels = [each.label for each in candidates]
    for label, run in zip(labels, loops, strict=True):
        if log is not None:
            say(f"{label}: {len(asked)} States of {log}")
        try:
            answers.append(run())
        except UsageError:
            raise
        except Hoap3Error as error:
            raise Hoap3Error(f"{label}: {error}") from error
    facts = _facts(answers[0], duration, seed, log)
    series = [
        read_series(found, each.parameters) for each, found in zip(candidates, answers, strict=True)
    ]
    others = [False] * len(series)
    if log is None:
        others = other_tasks([each.parameters for each in candidates], series)
    found = [
        figures(
            one,
            series[0],
            closed_loop=log is None,
            success_rate=each.success_rate,
            same_task=not other,
            judged=each.judged,
        )
        for one, each, other in zip(series, answers, others, strict=True)
    ]
    wrong = [
        f"{label}: its robot came to a safe stop after {each['answers']} answers"
        for label, each, answer in zip(labels, found, answers, strict=True)
        if answer.safe_stops
    ]
    for label, each in zip(labels, found, strict=True):
        wrong += findings(label, each)
    times = None
    if timing:
        say("timing")
        times = time_answers(labels, answers)
    differing = [label for label, other in zip(labels, others, strict=True) if other]
    return Comparison(facts, candidates, series, found, wrong, differing, times)


def _facts(
    answers: Answers, duration: float | None, seed: int | None, log: Path | None
) -> dict[str, Any]:
    """What was compared on; the duration of a log follows from its States."""
    description, stamps = answers.description, answers.states["stamp_intended"]
    if log is not None:
        duration = max(0.0, float(stamps[-1] - stamps[0]) / 1e9) + description.period_s
    return {
        "mode": "closed loop" if log is None else "open loop",
        "robot": description.name,
        "joints": description.n,
        "period_s": description.period_s,
        "duration_s": duration,
        "seed": seed,
        "log": None if log is None else str(log),
    }


def other_tasks(parameters: Sequence[dict[str, Any]], series: Sequence[Series]) -> list[bool]:
    """For each controller whether its task is another than that of the first.

    It is where both name their tasks and these differ, or where V differs at the start, from which
    all set out alike.

    Args:
        parameters: of each controller, defaults included.
        series: what each of them did in closed loop.
    """
    named = [_named(each) for each in parameters]
    starts = [float(each.lyapunov[0]) if len(each) else math.nan for each in series]
    return [
        task != named[0]
        if task is not None and named[0] is not None
        else abs(start - starts[0]) > ALIKE * max(start, starts[0])  # not so of NaN
        for task, start in zip(named, starts, strict=True)
    ]


def _named(parameters: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """The task that a controller's settings name, with its defaults, or None."""
    given = parameters.get("task")
    if not (isinstance(given, dict) and given.keys() == TaskSettings.model_fields.keys()):
        return None
    task = TaskSettings.model_validate(given)
    whole: dict[str, Any] = check_parameters(task).model_dump(mode="json")
    return task.task, whole
