"""Processes and signals: no process outlives its parent, and each one ends in order.

A child holds the read end of a pipe, its lifeline; only its parent holds the write end. The kernel
closes that when the parent ends, also by SIGKILL, and the child then ends by itself.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import pickle
import resource
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import unicodedata
import warnings
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, TextIO

from hoap3.protocol.errors import Hoap3Error, LimitWarning, UrdfWarning, UsageError


def printable(text: str) -> str:
    """A whole text: control characters as in a Python string; line breaks and tabs stay."""
    return "".join(_visible(char, "\n\t") for char in text)


def one_line(name: object) -> str:
    """A name or a sentence inside a line: line breaks and tabs are escaped, too."""
    return "".join(_visible(char, "") for char in str(name))


def _visible(char: str, keep: str) -> str:
    if char.isprintable() or char in keep or unicodedata.category(char) == "Zs":  # a space
        return char
    return char.encode("unicode_escape").decode()


SIZE = 1 << 17  # bytes; where glibc begins
_M_MMAP_THRESHOLD = -3


def give_back_large_blocks() -> None:
    """Have this process map each block of `SIZE` or more on its own, always.

    With each such block that is freed, glibc raises the size from which it does so, up to 32 MB.
    From then on they come from the heap, leave holes, and a process that needs as much as before
    grows all the same. A library without that setting is left alone.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, SIZE)


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
        order: what its `read_order` returns; None: its standard input is empty.
        pass_fds: open files that it takes over.
        stdout, stderr: as for `subprocess.Popen`.

    Raises:
        Hoap3Error: it ended before it had read its input.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        order: object = None,
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
                env={"OMP_NUM_THREADS": "1", **os.environ, _LIFELINE: str(reader)},
            )
        except BaseException:
            self._lifeline.close()
            raise
        finally:
            os.close(reader)
        try:
            if self.stdin is not None:
                with self.stdin as stream:
                    if order is not None:
                        pickle.dump(order, stream)
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


def check_libraries() -> None:
    """Refuse to start without the system's OpenMP library, which the wheels of pin lack.

    Raises:
        UsageError: it is not installed.
    """
    try:
        ctypes.CDLL("libgomp.so.1")
    except OSError as error:
        remedy = "`apt-get install libgomp1` on Debian and Ubuntu, `dnf install libgomp` on Fedora"
        raise UsageError(f"{error}. Install it: {remedy}") from error


def read_order() -> Any:
    """Return the order of a `Child`; exit where the parent died while it wrote that."""
    try:
        return pickle.load(sys.stdin.buffer)  # noqa: S301 - our parent has written it
    except (EOFError, pickle.UnpicklingError):
        sys.exit(1)  # with nobody left to tell


def tcp_pair(timeout_s: float) -> tuple[socket.socket, socket.socket]:
    """Two ends of a TCP connection over loopback, without delay."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname(), timeout=timeout_s)
        far, _ = server.accept()
    for end in (near, far):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end.settimeout(None)
    return near, far


_show_by_python = warnings.showwarning
_notes: set[str] = set()


def run_program(program: Callable[[], object]) -> None:
    """Run a program; an error of ours is one line for people, and an exit code."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read once, when numpy is imported
    warnings.showwarning = _show_warning
    try:
        for stream in (sys.stdout, sys.stderr):  # a terminal that knows ASCII only shows `?`
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")
        die_with_parent()
        program()
    except KeyboardInterrupt:
        sys.exit(1)
    except Hoap3Error as error:
        to_people(f"error: {error}")
        sys.exit(2 if isinstance(error, UsageError) else 1)
    except OSError as error:
        named = f" (found {error.filename!r:.80})" if error.filename else ""
        to_people(f"error: {error.strerror or error}{named}. Name another file or folder")
        sys.exit(1)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning about a robot or a config in one line, and others as Python does."""
    if issubclass(category, UrdfWarning):
        if str(message) not in _notes:  # a robot may be read more than once
            _notes.add(str(message))
            to_people(f"note: {message}")
    elif issubclass(category, LimitWarning):
        to_people(f"warning: {message}")
    else:
        _show_by_python(message, category, filename, lineno, file, line)
