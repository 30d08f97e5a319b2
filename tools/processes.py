"""Processes and signals: nothing outlives its parent, and every end is an orderly one."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from types import FrameType
from typing import Any

from tools.terminal import printable

PARENT = "HOAP3_PARENT"
_PR_SET_PDEATHSIG = 1


class StopFlag:
    """Set by SIGINT, SIGTERM and a terminal that closes; a loop asks it between two ticks.

    Args:
        handle: whether to take over the signals now.
    """

    def __init__(self, *, handle: bool = True) -> None:
        self.signal: int | None = None
        if handle:
            signal.signal(signal.SIGINT, self._note)
            signal.signal(signal.SIGTERM, self._note)
            if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as under nohup
                signal.signal(signal.SIGHUP, self._note)

    def __call__(self) -> bool:
        """Whether an end was asked for."""
        return self.signal is not None

    def wake(self, action: Callable[[], None]) -> None:
        """Call `action`, in a thread, when an end is asked for: the loop may be waiting."""
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

        def wait() -> None:
            while os.read(reader, 1):
                action()

        threading.Thread(target=wait, name="stop", daemon=True).start()

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.signal = number


def to_people(text: str) -> None:
    """A printable line on standard error; nothing waits for, or depends on, who reads it."""
    with contextlib.suppress(OSError):  # the terminal, or the pipe to it, is gone
        sys.stderr.write(printable(text) + "\n")
        sys.stderr.flush()


def die_with_parent() -> None:
    """Be told to stop when the process that started this one dies, however it dies."""
    parent = os.environ.pop(PARENT, None)
    if parent is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != int(parent):  # it died before we asked
        os.kill(os.getpid(), signal.SIGTERM)


def start_module(
    module: str, order: Mapping[str, Any], pass_fds: Sequence[int], *, stderr: int | None = None
) -> subprocess.Popen[bytes]:
    """Start one of our modules as a child that ends with us; `order` is its input, as JSON.

    Its standard output is a pipe.

    Args:
        module: it calls `die_with_parent` first.
        pass_fds: files that it takes over.
        stderr: as for `subprocess.Popen`.
    """
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", module],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        pass_fds=tuple(pass_fds),
        start_new_session=True,
        env={**os.environ, PARENT: str(os.getpid())},
    )
    if child.stdin is not None:
        child.stdin.write(json.dumps(order).encode())
        child.stdin.close()
        child.stdin = None  # or `communicate` would close it again
    return child


def tcp_pair(timeout_s: float) -> tuple[socket.socket, socket.socket]:
    """Two ends of a TCP connection over loopback, without delay."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname(), timeout=timeout_s)
        far, _ = server.accept()
    for end in (near, far):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end.settimeout(None)
    return near, far


def start_service(
    arguments: Sequence[str], config: str, pass_fds: Sequence[int]
) -> subprocess.Popen[bytes]:
    """Start one of our own commands as a child that ends with us; `config` is its input."""
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "tools.cli", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        pass_fds=tuple(pass_fds),
        start_new_session=True,  # Ctrl-C reaches us alone, and we stop the children in order
        env={**os.environ, PARENT: str(os.getpid())},
    )
    if child.stdin is not None:
        child.stdin.write(config.encode())
        child.stdin.close()
    return child
