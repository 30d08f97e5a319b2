"""CPUs kept awake by a process of its own: they may sleep again, however its parent ends."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

from hoap3.tools.machine.cpu_idle import PATIENCE_S, kept_awake, let_sleep
from hoap3.tools.machine.processes import Child, Lifeline

START_S = 5.0  # for the process to begin


@contextmanager
def kept_awake_apart(cpus: Sequence[int]) -> Iterator[None]:
    """Keep CPUs awake, where that is allowed, for as long as this is held or this process lives.

    Args:
        cpus: their numbers.

    Raises:
        OSError: the process cannot be started.
    """
    keeper = Child(
        ["hoap3.tools.machine.cpu_idle_apart", *map(str, cpus)], "", stdout=subprocess.PIPE
    )
    try:
        if keeper.stdout is not None:
            select.select([keeper.stdout], [], [], START_S)  # it has begun, or has ended
        yield
    finally:
        keeper.end(PATIENCE_S)
        if keeper.stdout is not None:
            keeper.stdout.close()
        let_sleep()


def main() -> None:
    """Keep the CPUs that are named as arguments awake until the parent ends, or wants that."""
    parent = Lifeline()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # the parent ends us
    with ExitStack() as awake:
        for cpu in sys.argv[1:]:
            awake.enter_context(kept_awake(int(cpu)))
        with suppress(BrokenPipeError):  # the parent is gone already
            os.write(sys.stdout.fileno(), b"awake\n")
        parent.cut(None)


if __name__ == "__main__":
    main()
