"""Runs a function in a process of its own, which sees the data of this one without a copy."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Generic, TypeVar

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
    """

    def __init__(self, work: Callable[[Say], Result]) -> None:
        context = get_context("fork")
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_run, args=(work, sender), daemon=True)
        self._process.start()
        sender.close()

    def result(self, say: Say) -> Result:
        """Wait for the result; `say` takes progress meanwhile.

        Raises:
            LogError: the process ended without a result, as where memory is short.
        """
        while True:
            try:
                kind, content = self._receiver.recv()
            except EOFError:
                self._process.join()
                ended = f"ended (exit code {self._process.exitcode})"
                raise LogError(f"a process that verifies the log {ended}") from None
            if kind == "result":
                found: Result = content
                return found
            say(content)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self._receiver.close()


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
