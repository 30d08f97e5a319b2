"""Compares controllers: runs them, and computes what the table, the page and the files say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.tools.compare.answers import Answers
from hoap3.tools.compare.candidates import Candidate, read_candidates
from hoap3.tools.compare.closed_loop import ClosedLoop
from hoap3.tools.compare.figures import Figures, figures, findings
from hoap3.tools.compare.open_loop import OpenLoop, read_asked
from hoap3.tools.compare.series import Series, read_series
from hoap3.tools.compare.tasks import other_tasks
from hoap3.tools.compare.timing import measure
from hoap3.tools.machine.machine import versions
from hoap3.tools.simulate import emulator_content, emulator_settings

ROBOT, DURATION_S, SEED = "hoap3", 20.0, 0
Say = Callable[[str], None]
Ready = Callable[[], None]
Loop = TypeVar("Loop", ClosedLoop, OpenLoop)


@dataclass(frozen=True)
class Comparison:
    """Controllers beside each other.

    Attributes:
        facts: what they were compared on: mode, robot, joints, period_s, duration_s, seed, log.
        candidates, series, figures: one each, in the order in which they were named.
        findings: what is wrong, in words.
        other_tasks: labels of those whose task is another than the first one's.
        timing: how long they take, see `timing.measure`; None where nobody asked.
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
    ready: Ready = lambda: None,
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
        facts, answers = _closed(
            candidates,
            ROBOT if robot is None else robot,
            DURATION_S if duration is None else duration,
            SEED if seed is None else seed,
            say,
            ready,
        )
    else:
        given = {"--robot": robot, "--duration": duration, "--seed": seed}
        wrong = [name for name, value in given.items() if value is not None]
        if wrong:
            raise UsageError(f"{wrong[0]}: comes from the log {log}. Drop it, or drop --log")
        facts, answers = _open(candidates, log, say, ready)
    labels = [each.label for each in candidates]
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
        times = measure(labels, answers)
    differing = [label for label, other in zip(labels, others, strict=True) if other]
    return Comparison(facts, candidates, series, found, wrong, differing, times)


def _closed(
    candidates: list[Candidate], robot: str, duration: float, seed: int, say: Say, ready: Ready
) -> tuple[dict[str, Any], list[Answers]]:
    emulator = emulator_settings(robot, seed)
    file = emulator_content(robot)[1]
    loops = [ClosedLoop(each, emulator, file) for each in candidates]
    ready()

    def run(label: str, loop: ClosedLoop) -> Answers:
        return loop.run(duration, lambda text: say(f"{label}: {text}"))

    answers = _run(candidates, loops, run)
    facts = {"mode": "closed loop", **_robot(answers[0])}
    return {**facts, "duration_s": duration, "seed": seed, "log": None}, answers


def _open(
    candidates: list[Candidate], log: Path, say: Say, ready: Ready
) -> tuple[dict[str, Any], list[Answers]]:
    asked = read_asked(log)
    loops = [OpenLoop(each, asked) for each in candidates]
    ready()

    def run(label: str, loop: OpenLoop) -> Answers:
        say(f"{label}: {len(asked.payloads)} States of {log}")
        return loop.run()

    answers = _run(candidates, loops, run)
    facts = {"mode": "open loop", **_robot(answers[0])}
    stamps, period = answers[0].states["stamp_intended"], asked.description.period_s
    duration = max(0.0, float(stamps[-1] - stamps[0]) / 1e9) + period
    return {**facts, "duration_s": duration, "seed": None, "log": str(log)}, answers


def _run(
    candidates: list[Candidate], loops: list[Loop], run: Callable[[str, Loop], Answers]
) -> list[Answers]:
    """Answers of each; says which controller failed, but wrong usage names its own place."""
    answers = []
    for each, loop in zip(candidates, loops, strict=True):
        try:
            answers.append(run(each.label, loop))
        except UsageError:
            raise
        except Hoap3Error as error:
            raise Hoap3Error(f"{each.label}: {error}") from error
    return answers


def _robot(answers: Answers) -> dict[str, Any]:
    description = answers.description
    sizes = {"joints": description.n, "period_s": description.period_s}
    return {"robot": description.name, **sizes}
