"""What the builders of acceleration controllers find in the records of `driven_motion`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.problems.acceleration import AccelerationProblems
from hoap3.remote_controller.problems.check import check
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.statement import Statement
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import check_statements

FIELDS = (
    "v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual", "active_joints",
    "solver_status", "solver_path", "fallback", "command", "values", "decision", "extra",
)  # fmt: skip
EVERY = 40  # answers: one of them is changed
PLACES = 4  # of an array that are changed


def check_motion(builder: ProblemBuilder, records: list[Record]) -> Claims:
    """Check all answers."""
    claims = Claims()
    check_statements(records[2:], builder, claims)
    return claims


def missed_changes(builder: ProblemBuilder, records: list[Record]) -> list[tuple[int, str, int]]:
    """Return which changed numbers of some answers are not found: tick, field and place."""
    random, found, count = np.random.default_rng(3), [], 0
    for setpoint in some_answers(builder, records, EVERY):
        for field in FIELDS:
            size = setpoint[field].size
            for place in random.choice(size, min(size, PLACES), replace=False):
                builder.history.answer = tampered(setpoint, field, place)
                count += 1
                if not failing(builder.problem()):
                    found.append((int(setpoint["tick"]), field, int(place)))
        builder.history.answer = setpoint
    print(f"{count - len(found)} of {count} changed numbers found")
    assert count > 0
    return found


def missed_motions(builder: AccelerationProblems, records: list[Record], by: float) -> list[int]:
    """Return the ticks at which another q̈ with consistent torques passes for the optimum.

    Args:
        builder: of the problems.
        records: of a robot that takes torques or accelerations.
        by: how far q̈ is moved, of the largest acceleration.
    """
    random, missed, count = np.random.default_rng(4), [], 0
    for setpoint in some_answers(builder, records, EVERY // 4):
        if not builder.history.finite:
            continue
        cycle, moved = builder._cycle(setpoint), setpoint.copy()
        n, span = len(cycle.ddq), max(np.abs(cycle.ddq).max(), 1e-6)
        ddq = cycle.ddq + by * span * random.normal(size=n)
        tau = cycle.M @ ddq + cycle.h
        moved["decision"][:n], moved["decision"][n:] = ddq, tau
        moved["values"][:] = tau - cycle.added if builder._torques else ddq
        builder.history.answer = moved
        count += 1
        if not {"optimum", "rows", "answer"} & set(failing(builder.problem())):
            missed.append(int(setpoint["tick"]))
    print(f"{count - len(missed)} of {count} other motions found")
    assert count > 0
    return missed


def tampered(setpoint: Any, field: str, place: int, by: float = 1e-6) -> Any:
    """The answer with one number that is a little larger, or 1 larger of integers."""
    changed = setpoint.copy()
    old = setpoint[field] if setpoint[field].ndim == 0 else setpoint[field][place]
    small = abs(old) < 1e-2  # beside others: answers are exact relative to the largest number
    larger = old + 1 if old.dtype.kind in "ui" else old * (1.0 + by) + by * small
    if setpoint[field].ndim == 0:
        changed[field] = larger
    else:
        changed[field][place] = larger
    return changed


def some_answers(
    builder: ProblemBuilder, records: list[Record], every: int, first: int = 7
) -> Iterator[Any]:
    """Each so many answers, as rows, when the builder has just read them; each of them is true."""
    number = 0
    for kind, _, payload in records[2:]:
        builder.feed(kind, payload)
        if kind == Kind.SETPOINT:
            if number % every == first:
                assert failing(builder.problem()) == []
                yield builder.history.answer
            number += 1


def failing(statement: Statement | None) -> list[str]:
    assert statement is not None
    return [finding.name for finding in check(statement) if not finding.holds]
