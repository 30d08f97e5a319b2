"""Certified runs that never happened, for tests of what is made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hoap3.tools.reproduce.papers.qp12.certified import CertifiedRun

TICKS = 1000


def good_run(**changes: object) -> CertifiedRun:
    """A run of 1 s in which V falls as asked; `changes` replace its arrays."""
    t = np.arange(TICKS) * 1e-3
    v = 1e-4 * np.exp(-t)
    run = CertifiedRun(
        q=np.zeros((TICKS, 21)),
        v=v,
        psi=v,
        required=-v,
        given=-v,
        rho=np.ones(TICKS),
        margin=np.full(TICKS, 1e-3),
        status=np.zeros(TICKS, np.int64),
        held=frozenset(),
    )
    return replace(run, **changes)  # type: ignore[arg-type]


def failed(rows: list[object]) -> list[str]:
    """Items of the rows that do not pass."""
    return [row.item for row in rows if row.passed is not True]  # type: ignore[attr-defined]
