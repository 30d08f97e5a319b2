"""Runs a function in a process of its own, which sees the data of this one without a copy."""

from __future__ import annotations

import ctypes
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
PROGRESS_S = 1.0  # between two reports: they must not fill the pipe, which is read at the end


class Forked(Generic[Result]):
    """A function that runs beside this process, from now on.

    What this process has open is shared with it: files must not have anything left to be written.

    Args:
        work: what is computed; takes a function for progress. Its result must be picklable.

    Attributes:
        receiver: has something to read when `receive` does not have to wait.
    """

    def __init__(self, work: Callable[[Say], Result]) -> None:
        context = get_context("fork")
        self.receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_run, args=(work, sender), daemon=True)
        self._process.start()
        sender.close()

    def receive(self) -> tuple[str, Any]:
        """Wait for what it sends next: ("progress", text), or ("result", value) at the end.

        Raises:
            LogError: the process ended without a result, as where memory is short.
        """
        try:
            found: tuple[str, Any] = self.receiver.recv()
        except EOFError:
            self._process.join()
            ended = f"ended (exit code {self._process.exitcode})"
            raise LogError(f"a process that verifies the log {ended}") from None
        return found

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.receiver.close()


def gather(processes: Sequence[Forked[Result]], say: Say) -> list[Result]:
    """Wait for the results of all processes, in their order.

    Args:
        processes: that run.
        say: takes the progress of each as it arrives.

    Raises:
        LogError: one of them ended without a result.
    """
    running = {process.receiver: place for place, process in enumerate(processes)}
    found: dict[int, Result] = {}
    while running:
        for receiver in wait(list(running)):
            place = running[cast("Connection", receiver)]
            kind, content = processes[place].receive()
            if kind == "result":
                found[place] = content
                del running[cast("Connection", receiver)]
            else:
                say(content)
    return [found[place] for place in range(len(processes))]


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0))


def _run(work: Callable[[Say], Result], sender: Connection) -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), 0, 0, 0)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    next_report = time.monotonic()

    def say(text: str) -> None:
        nonlocal next_report
        if time.monotonic() >= next_report:
            next_report = time.monotonic() + PROGRESS_S
            sender.send(("progress", text))

    with suppress(BrokenPipeError):  # nobody waits for the result any more
        sender.send(("result", work(say)))
