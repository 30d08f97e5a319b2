"""The proof of the robot's authority: a search, and faults that it finds."""

from __future__ import annotations

from collections.abc import Callable

from ..claims import Proof
from .mutants import MUTANTS, search_with
from .search import search


def prove_authority(
    clients: int = 3,
    requests: int = 6,
    crashes: int = 2,
    *,
    faults: bool = True,
    tell: Callable[[str], None] | None = None,
) -> Proof:
    """Search every world of so many clients, requests and crashes.

    Args:
        clients, requests, crashes: see `search`.
        faults: whether planted faults are searched for, too.
        tell: is told what is looked at.
    """
    proof, told = Proof("authority"), tell or _silent
    found = search(clients, requests, crashes, lambda worlds: told(f"{worlds} states so far"))
    size = f"{found.worlds} states, {found.transitions} transitions, depth {found.depth}"
    given = f"{clients} clients, {requests} requests, {crashes} crashes"
    detail = f"{found.wrong}: {'; '.join(found.story)}" if found.wrong else size
    proof.note(f"one holder, none for ever ({given})", not found.wrong, detail)
    for mutant in MUTANTS if faults else ():
        told(mutant.what)
        proof.fault(mutant.what, search_with(mutant).wrong)
    return proof


def _silent(_: str) -> None:
    """Nobody listens."""
