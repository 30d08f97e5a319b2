"""`hoap3 view`: a source, a server, and their end."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from hoap3.protocol.config.endpoints import is_loopback
from hoap3.tools.view.access import new_token
from hoap3.tools.view.server import PageServer
from hoap3.tools.view.sources.live import Live
from hoap3.tools.view.sources.log_source import LogSource
from hoap3.tools.view.steering.operator import Operator

NICE = 5
"""Behind whatever else wants a CPU: a picture may come later, a tick may not."""


def serve_robot(
    robot: str,
    endpoint: str,
    host: str,
    port: int,
    folder: str | None,
    ready: Callable[[str], None],
    *,
    steering: bool = True,
) -> None:
    """Show a running robot until SIGINT or SIGTERM.

    Args:
        robot, endpoint: its name, and where it is reached.
        host, port: where to listen.
        folder: of the robot on this machine, or None.
        ready: is told the address of the page.
        steering: whether a page may do anything but look.

    Raises:
        LinkError: the robot cannot be reached.
        PortInUseError, ConfigError: see `PageServer.run`.
    """
    os.nice(NICE)
    source = Live(robot, endpoint, folder)
    try:
        asyncio.run(_robot(source, host, port, ready, steering=steering))
    finally:
        source.close()


def serve_log(
    logs: Sequence[Path],
    host: str,
    port: int,
    folder: str | None,
    ready: Callable[[str], None],
) -> None:
    """Show a log, or two over each other, until SIGINT or SIGTERM.

    Raises:
        LogError: one cannot be read.
        PortInUseError, ConfigError: see `PageServer.run`.
    """
    source = LogSource(logs, folder)
    try:
        asyncio.run(_until_told(PageServer(source, None, None, host, port), ready))
    finally:
        source.close()


def warn_of(host: str) -> str:
    """What to say where others than this machine reach the page; "" where none do."""
    if is_loopback(host):
        return ""
    return (
        f"listening at {host}: whoever reaches this port sees the robot, and nothing is encrypted. "
        "Whoever can alter the traffic can change the page, take the token out of its address, and "
        "steer. Safer is to listen on loopback and use `ssh -L 8080:127.0.0.1:8080`"
    )


async def _robot(
    source: Live, host: str, port: int, ready: Callable[[str], None], *, steering: bool
) -> None:
    operator: Operator | None = None
    server: PageServer | None = None

    def tell(event: dict[str, object]) -> None:
        if server is not None:
            server.tell_all(event)

    if steering:
        operator = Operator(source, tell)
    token = new_token() if steering else None
    server = PageServer(source, operator, token, host, port)
    try:
        await _until_told(server, ready)
    finally:
        if operator is not None:
            await asyncio.to_thread(operator.close)


async def _until_told(server: PageServer, ready: Callable[[str], None]) -> None:
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stop.set)
    await server.run(stop, ready)
