"""Answers with one number changed, and which of the changes are found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.check import check
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.statement import Statement

FIELDS = (
    "v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual", "active_joints",
    "solver_status", "solver_path", "fallback", "command", "values", "decision", "extra",
)  # fmt: skip


def failing(statement: Statement | None) -> list[str]:
    assert statement is not None
    return [finding.name for finding in check(statement) if not finding.holds]


def tampered(setpoint: Any, field: str, place: int, by: float = 1e-6) -> Any:
    """The answer with one number that is a little larger, or 1 larger of integers."""
    changed = setpoint.copy()
    old = setpoint[field] if setpoint[field].ndim == 0 else setpoint[field][place]
    larger = old + 1 if old.dtype.kind in "ui" else old * (1.0 + by) + by * (abs(old) < 1e-3)
    if setpoint[field].ndim == 0:
        changed[field] = larger
    else:
        changed[field][place] = larger
    return changed


def missed(
    statements: Iterable[tuple[ProblemBuilder, Any]], first: int = 7
) -> list[tuple[int, str, int]]:
    """Changed numbers that are not found, at each 40th answer; tick, field and place."""
    random, found, count = np.random.default_rng(3), [], 0
    for number, (builder, setpoint) in enumerate(statements):
        if number % 40 != first:
            continue
        assert failing(builder.problem()) == []
        for field in FIELDS:
            size = setpoint[field].size
            for place in random.choice(size, min(size, 4), replace=False):
                builder.history.answer = tampered(setpoint, field, place)
                count += 1
                if not failing(builder.problem()):
                    found.append((int(setpoint["tick"]), field, int(place)))
        builder.history.answer = setpoint
    print(f"{count - len(found)} of {count} changed numbers found")
    assert count > 0
    return found
