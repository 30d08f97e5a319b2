"""Processes and signals: no process outlives its parent, and each one ends in order.

A child holds the read end of a pipe, its lifeline; only its parent holds the write end. The kernel
closes that when the parent ends, also by SIGKILL, and the child then ends by itself.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import FrameType
from typing import Any

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.tools.machine.terminal import printable

ORDERLY_END_S = 60.0  # for a service whose parent is gone; then it is killed
OPEN_FILES = 64  # a robot with its controller and tools had 15
MEMORY_MB = 1024  # address space of a process with numba, SciPy and Pinocchio: 690 were used
SERVICE_MB = 2048  # with Zenoh and its threads: 1,530
_LIFELINE = "HOAP3_LIFELINE"


class StopFlag:
    """Set by SIGINT, SIGTERM and a terminal that closes; a loop asks it between two ticks."""

    def __init__(self) -> None:
        self.signal: int | None = None
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


class Child(subprocess.Popen[bytes]):
    """One of our modules in a process that ends when this one does, however this one ends.

    The module takes its `Lifeline`, or calls `die_with_parent`, before anything else.

    Args:
        arguments: the module, and its arguments.
        text: its standard input.
        pass_fds: open files that it takes over.
        stdout, stderr: as for `subprocess.Popen`.

    Raises:
        Hoap3Error: it ended before it had read its input.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        text: str,
        pass_fds: Sequence[int] = (),
        *,
        stdout: int | None = subprocess.DEVNULL,
        stderr: int | None = None,
    ) -> None:
        reader, writer = os.pipe()  # neither is inherited, but for what `pass_fds` names
        self._lifeline = os.fdopen(writer, "wb", buffering=0)
        try:
            super().__init__(
                [sys.executable, "-P", "-m", *arguments],
                stdin=subprocess.PIPE,
                stdout=stdout,
                stderr=stderr,
                pass_fds=(*pass_fds, reader),
                start_new_session=True,  # a Ctrl-C at the terminal is for its parent alone
                env={**os.environ, _LIFELINE: str(reader)},
            )
        except BaseException:
            self._lifeline.close()
            raise
        finally:
            os.close(reader)
        try:
            if self.stdin is not None:
                with self.stdin as stream:
                    stream.write(text.encode())
                self.stdin = None  # or `communicate` would close it again
        except BaseException as error:
            self.end(0.0)
            if isinstance(error, BrokenPipeError):
                raise Hoap3Error(f"{arguments[0]} ended at its start") from error
            raise

    def cut(self) -> None:
        """Close its lifeline: it is to end."""
        self._lifeline.close()

    def end(self, patience_s: float) -> int:
        """Close its lifeline, wait, and kill it where it still runs after `patience_s` [s].

        Returns:
            Its exit code; negative: the signal that killed it.
        """
        self.cut()
        try:
            return self.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.kill()
            return self.wait()


class Lifeline:
    """The end of the pipe that a `Child` has; a process that nobody of us started has none."""

    def __init__(self) -> None:
        self._poll = select.poll()
        self.exists = _LIFELINE in os.environ
        if self.exists:
            self._poll.register(int(os.environ.pop(_LIFELINE)), 0)  # its end is always told

    def cut(self, timeout_s: float | None = 0.0) -> bool:
        """Whether the parent is gone, or wants us to end; waits for that, None: without a limit."""
        return bool(self._poll.poll(None if timeout_s is None else timeout_s * 1e3))


def die_with_parent() -> None:
    """Get SIGTERM when the process that started this one ends, and SIGKILL if that has no effect.

    It takes a thread, which sleeps until then.
    """
    lifeline = Lifeline()
    if not lifeline.exists:
        return

    def wait() -> None:
        lifeline.cut(None)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(ORDERLY_END_S)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()


def start_module(
    module: str, order: Mapping[str, Any], pass_fds: Sequence[int], *, stderr: int | None = None
) -> Child:
    """Start one of our modules as a child that ends with us; `order` is its input, as JSON.

    Its standard output is a pipe.

    Args:
        module: it calls `die_with_parent` first, then `read_order`.
        pass_fds: files that it takes over.
        stderr: as for `subprocess.Popen`.
    """
    return Child([module], json.dumps(order), pass_fds, stdout=subprocess.PIPE, stderr=stderr)


def check_open_files() -> None:
    """Refuse to start a service that could not open what it needs.

    Raises:
        UsageError: too few files may be open at a time.
    """
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed != resource.RLIM_INFINITY and allowed < OPEN_FILES:
        raise UsageError(
            f"this process may open {allowed} files at a time, and needs up to {OPEN_FILES}: "
            "`ulimit -n 1024`, or LimitNOFILE=1024 in its systemd unit"
        )


def check_memory(needed_mb: int | None = None) -> None:
    """Refuse what would run out of memory while it is imported, where OpenBLAS retries for ever.

    Raises:
        UsageError: too little address space.
    """
    allowed, needed_mb = resource.getrlimit(resource.RLIMIT_AS)[0], needed_mb or MEMORY_MB
    if allowed != resource.RLIM_INFINITY and allowed < needed_mb << 20:
        raise UsageError(
            f"this process may use {allowed >> 20} MB of address space, and needs {needed_mb}: "
            "`ulimit -v unlimited`, or LimitAS=infinity in its systemd unit"
        )


def read_order() -> dict[str, Any]:
    """The JSON object on standard input; where the parent died while it wrote that, this ends."""
    try:
        order: dict[str, Any] = json.load(sys.stdin)
    except ValueError:
        sys.exit(1)  # with nobody left to tell
    return order


def tcp_pair(timeout_s: float) -> tuple[socket.socket, socket.socket]:
    """Two ends of a TCP connection over loopback, without delay."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname(), timeout=timeout_s)
        far, _ = server.accept()
    for end in (near, far):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end.settimeout(None)
    return near, far
