"""Runs functions in processes of their own, which see the data of this one without a copy."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar, cast

from hoap3.protocol.errors import LogError

Result = TypeVar("Result")
Say = Callable[[str], None]

_PR_SET_PDEATHSIG = 1
PROGRESS_S = 1.0  # between two reports


class Forked(Generic[Result]):
    """Functions that run beside this process, from now on, a few of them at a time.

    What this process has open is shared with them: files must not have anything left to be
    written.

    Args:
        works: what is computed, in the order in which they start; each takes a function for
            progress. Results must be picklable.
        processes: how many run at a time, at least 1.
    """

    def __init__(self, works: Sequence[Callable[[Say], Result]], processes: int) -> None:
        context = get_context("fork")
        self._count, begun = len(works), context.Value("i", 0)
        self._processes = {}
        gc.freeze()  # its collections would copy what the processes share
        try:
            for _ in range(min(processes, len(works))):
                receiver, sender = context.Pipe(duplex=False)
                process = context.Process(target=_run, args=(works, begun, sender), daemon=True)
                process.start()
                sender.close()
                self._processes[receiver] = process
        except OSError:
            self.end()
            raise
        finally:
            gc.unfreeze()

    def gather(self, say: Say) -> list[Result]:
        """Wait for all results, in the order of the functions.

        Args:
            say: takes the progress of each as it arrives.

        Raises:
            LogError: a process ended without a result, as where memory is short.
        """
        running, found = dict(self._processes), dict[int, Result]()
        while running:
            for receiver in wait(list(running)):
                try:
                    place, content = cast("Connection", receiver).recv()
                except EOFError:
                    process = running.pop(cast("Connection", receiver))
                    process.join()
                    if process.exitcode:
                        ended = f"ended (exit code {process.exitcode})"
                        raise LogError(f"a process that verifies the log {ended}") from None
                    continue
                if place is None:
                    say(content)
                else:
                    found[place] = content
        if len(found) < self._count:
            raise LogError("a process that verifies the log ended without a result")
        return [found[place] for place in range(self._count)]

    def end(self) -> None:
        """End all processes, whatever they do."""
        for receiver, process in self._processes.items():
            process.kill()
            process.join()
            receiver.close()


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0))


def _run(works: Sequence[Callable[[Say], Any]], begun: Any, sender: Connection) -> None:
    """Take one function after the other that no process has begun, and send their results."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), 0, 0, 0)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    next_report = time.monotonic()

    def say(text: str) -> None:
        nonlocal next_report
        if time.monotonic() >= next_report:
            next_report = time.monotonic() + PROGRESS_S
            sender.send((None, text))

    with suppress(BrokenPipeError):  # nobody waits for the result any more
        while True:
            with begun.get_lock():
                place = begun.value
                begun.value += 1
            if place >= len(works):
                break
            sender.send((place, works[place](say)))
    sender.close()
