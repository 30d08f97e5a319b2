"""A push in a process of its own, for a solver that may never return."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from hoap3.protocol.errors import Hoap3Error

LONGEST_S = 120.0  # of a push that takes some 10 s where the solver answers


def answer_within(limit_s: float, ask: Callable[..., bool], *given: Any) -> bool | None:
    """What a function says; None where it says nothing in time, and is ended.

    Args:
        limit_s: time that it has, the start of its process included [s].
        ask, given: a function of a module, and what it is called with.

    Raises:
        Hoap3Error: it died.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(theirs, ask, given), daemon=True)
    child.start()
    theirs.close()
    try:
        if not ours.poll(limit_s):
            return None
        found: bool = ours.recv()
    except EOFError as error:
        child.join()
        raise Hoap3Error(f"a process of a peer ended with code {child.exitcode}") from error
    else:
        return found
    finally:
        child.kill()
        child.join()
        ours.close()


def _answer(theirs: Connection, ask: Callable[..., bool], given: tuple[Any, ...]) -> None:
    theirs.send(bool(ask(*given)))
