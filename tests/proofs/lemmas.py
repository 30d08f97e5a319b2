"""Lemmas in real numbers, each handed to z3: it is proved where its denial has no solution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

TIMEOUT_MS = 60_000


class Lemma(NamedTuple):
    """For all reals: if all of `given`, then `then`.

    Attributes:
        name: what it says.
        given, then: formulas of z3.
    """

    name: str
    given: tuple[Any, ...]
    then: Any


def refuted(lemma: Lemma) -> str:
    """What is wrong with a lemma: numbers for which it is not true, or "undecided"; else ""."""
    import z3

    solver = z3.Solver()
    solver.set("timeout", TIMEOUT_MS)
    solver.add(*lemma.given, z3.Not(lemma.then))
    answer = solver.check()
    if answer == z3.unsat:
        return ""
    if answer == z3.unknown:
        return f"undecided: {solver.reason_unknown()}"
    model = solver.model()
    return ", ".join(sorted(f"{name} = {model[name]}" for name in model.decls()))


def contradictory(lemma: Lemma) -> bool:
    """Whether nothing at all satisfies what is given: such a lemma would say nothing."""
    import z3

    solver = z3.Solver()
    solver.set("timeout", TIMEOUT_MS)
    solver.add(*lemma.given)
    return bool(solver.check() == z3.unsat)


def judged(lemma: Lemma) -> str:
    """What is wrong with a lemma, or "": it is proved, and what is given can be."""
    return refuted(lemma) or ("nothing satisfies what is given" if contradictory(lemma) else "")


Lemmas = Callable[[], tuple[Lemma, ...]]
