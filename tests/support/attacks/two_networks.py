"""Two network namespaces, joined by a cable: what runs in one reaches the other by that alone.

They have no names, belong to two processes that wait, and end with them. An ordinary user makes
them in a user namespace of his own.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Self

ROBOT, FIELD = "10.77.0.1", "10.77.0.2"
WAITS = ("sh", "-c", "echo && exec cat")


class TwoNetworks:
    """Both, while the context lasts.

    Attributes:
        robot: what starts a command in the one whose address is `ROBOT`.
        field: likewise in the one whose address is `FIELD`.
    """

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            root = os.geteuid() == 0
            own = () if root else ("--user", "--map-root-user")
            first = _waiting(stack, ("unshare", *own, "--net", *WAITS))
            same = () if root else ("--user", "--preserve-credentials")
            self.robot = ("nsenter", f"--target={first}", *same, "--net")
            second = _waiting(stack, (*self.robot, "unshare", "--net", *WAITS))
            self.field = ("nsenter", f"--target={second}", *same, "--net")
            _run(self.robot, f"ip link add name cable type veth peer name cable netns {second}")
            for wrapper, address in ((self.robot, ROBOT), (self.field, FIELD)):
                _run(wrapper, f"ip address add {address}/24 dev cable")
                _run(wrapper, "ip link set cable up")
                _run(wrapper, "ip link set lo up")
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def _waiting(stack: ExitStack, words: Sequence[str]) -> int:
    """A process that waits until the end, in a namespace that is there."""
    pipe = subprocess.PIPE
    process: subprocess.Popen[Any] = subprocess.Popen(words, stdin=pipe, stdout=pipe)
    stack.callback(process.communicate)
    assert process.stdout is not None
    assert process.stdout.readline() == b"\n", f"cannot make a network: {' '.join(words)}"
    return process.pid


def _run(wrapper: Sequence[str], command: str) -> None:
    subprocess.run([*wrapper, *command.split()], check=True)
