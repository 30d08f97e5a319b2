"""Where clients of HOAP-3's protocol come in: two ports, and one client at a time.

A client says at the first port how many exchanges it wants, and then has them at the second one.
Whoever comes at another time, or to the wrong port, is sent away at once.
"""

from __future__ import annotations

import errno
import select
import socket
import time
from collections.abc import Callable

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.errors import LinkError, PortInUseError, WireError
from hoap3.protocol.link.hoap3_tcp.frames import BEGINNING, exchanges, set_up

LOOK_S = 0.1  # how often it is looked whether the link was closed
PATIENCE_S = 10.0  # for the 16 bytes of the beginning, before which a controller is built
CONNECT_S = 5.0  # from these to the connection on the other port


class Hoap3Reception:
    """Both listeners. Used by one thread; nothing here blocks for longer than its `ended` is heard.

    Args:
        settings: address and ports.
        ended: asked while waiting.
        report: takes why a client was refused.

    Attributes:
        ports: on which it listens: for the beginning, and for frames.
        refused: connections that were sent away.

    Raises:
        PortInUseError, LinkError: it cannot listen.
    """

    def __init__(
        self,
        settings: Hoap3TcpSettings,
        ended: Callable[[], bool],
        report: Callable[[str], None],
    ) -> None:
        self._ended, self._report = ended, report
        self.refused = 0
        self._init_listener = _listen(settings.host, settings.init_port)
        try:
            self._control_listener = _listen(settings.host, settings.control_port)
        except LinkError:
            self._init_listener.close()
            raise
        self.listeners = (self._init_listener, self._control_listener)
        self.ports = tuple(listener.getsockname()[1] for listener in self.listeners)

    def next_client(self) -> tuple[socket.socket, int] | None:
        """Who has come, and how many exchanges it wants; None where nobody has for a moment."""
        ready = _readable(self.listeners)
        beginning = _accept(self._init_listener) if self._init_listener in ready else None
        if beginning is None:
            if self._control_listener in ready:
                self.send_away(self._control_listener)
            return None
        try:
            with beginning:
                wanted = exchanges(self._first_bytes(beginning))
            return self._control_connection(), wanted
        except (OSError, WireError) as error:
            if not self._ended():
                self.refused += 1
                self._report(f"a client was refused: {error}")
            return None

    def send_away(self, listener: socket.socket) -> None:
        """Close a connection that nobody waits for."""
        connection = _accept(listener)
        if connection is not None:
            connection.close()
            self.refused += 1

    def close(self) -> None:
        """Stop to listen."""
        for listener in self.listeners:
            listener.close()

    def _first_bytes(self, beginning: socket.socket) -> bytes:
        """What a client sends first; others wait until it has.

        Raises:
            OSError: it has gone, or is too slow; or we end.
        """
        data, until = b"", time.monotonic() + PATIENCE_S
        while len(data) < BEGINNING.size:
            if self._ended() or time.monotonic() > until:
                raise TimeoutError(f"sent {len(data)} of 16 bytes within {PATIENCE_S:g} s")
            ready = _readable((beginning, self._control_listener))
            if beginning in ready:  # first: its own second connection may be there, too
                more = beginning.recv(BEGINNING.size - len(data))
                if not more:
                    raise ConnectionError(f"has gone after {len(data)} of 16 bytes")
                data += more
            elif ready:
                self.send_away(self._control_listener)
        return data

    def _control_connection(self) -> socket.socket:
        """The connection that has the frames.

        Raises:
            OSError: it does not come; or we end.
        """
        until = time.monotonic() + CONNECT_S
        while not self._ended() and time.monotonic() < until:
            ready = _readable(self.listeners)
            if self._init_listener in ready:
                self.send_away(self._init_listener)
            connection = (
                _accept(self._control_listener) if self._control_listener in ready else None
            )
            if connection is not None:
                if _is_open(connection):
                    return connection
                connection.close()  # one that an earlier client left
        raise TimeoutError(f"did not connect to port {self.ports[1]} within {CONNECT_S:g} s")


def _readable(sockets: tuple[socket.socket, ...]) -> list[socket.socket]:
    return select.select(sockets, (), (), LOOK_S)[0]


def _accept(listener: socket.socket) -> socket.socket | None:
    """Who has connected, ready for frames; None where it has gone again."""
    connection = None
    try:
        connection, _ = listener.accept()
        set_up(connection)
    except OSError:
        if connection is not None:
            connection.close()
        return None
    return connection


def _is_open(connection: socket.socket) -> bool:
    """Whether who connected, maybe long ago, is still there."""
    try:
        return connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def _listen(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()
        listener.setblocking(False)  # who was waiting may be gone when it is accepted
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise PortInUseError(
                f"{host}:{port} is in use: another robot runs there. Stop it, or set "
                "link.hoap3_tcp to free ports"
            ) from error
        raise LinkError(
            f"cannot listen at {host}:{port}: {error.strerror or error}. Set link.hoap3_tcp.host "
            "to an address of this machine"
        ) from error
    return listener
