"""A link between a robot and its controller that now and then delivers late."""

from __future__ import annotations

import socket
import threading
import time


class HoldingLink:
    """Passes the bytes of one TCP connection on; once every `every` [ns] it holds all for `hold`.

    Args:
        port: of the robot, on loopback.

    Attributes:
        endpoint: where the controller finds the robot through this.
        windows: begin and end of each time in which something was held [ns].
    """

    def __init__(self, port: int, every: int, hold: int) -> None:
        self._every, self._hold = every, hold
        self.windows: list[tuple[int, int]] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        self._robot = socket.create_connection(("127.0.0.1", port))
        self._thread = threading.Thread(target=self._meet, daemon=True)
        self._thread.start()

    def _meet(self) -> None:
        controller, _ = self._server.accept()
        back = threading.Thread(target=self._pass_on, args=(controller, self._robot), daemon=True)
        back.start()
        self._pass_on(self._robot, controller, holds=True)
        back.join()
        controller.close()

    def _pass_on(self, source: socket.socket, sink: socket.socket, *, holds: bool = False) -> None:
        sink.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            while data := source.recv(65536):
                if holds and (left := self._hold - time.monotonic_ns() % self._every) > 0:
                    begin = time.monotonic_ns()
                    time.sleep(left / 1e9)  # this is what is late, not somebody who waits
                    self.windows.append((begin, time.monotonic_ns()))
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            source.close()  # one of them was killed

    def close(self) -> None:
        """After both ends are gone."""
        self._robot.close()
        self._server.close()
