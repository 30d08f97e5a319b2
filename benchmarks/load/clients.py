"""Clients of a running robot, in a process of their own: one steers, the others look on."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from contextlib import suppress
from typing import Any

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.tools.machine.processes import Lifeline, read_order
from hoap3.tools.services.connection import Connection, connect

PATIENCE_S = 60.0  # for a robot that starts
CENTRE_M, RADIUS_M, ROUND_S = (-0.55, -0.11, 0.3), 0.05, 8.0  # of what `steered_ur5` is told


class Clients:
    """Connections, each in a thread and each at the same rate.

    Args:
        order: `robot`, its name; `endpoint`; `count`; `rate_hz` of each.

    Attributes:
        figures: what they did: `states` read, `targets` sent, and `failed`, why one
            never began.
    """

    def __init__(self, order: dict[str, Any]) -> None:
        self._robot, self._endpoint = order["robot"], order["endpoint"]
        self._period_s = 1.0 / order["rate_hz"]
        self._ended, self._lock = threading.Event(), threading.Lock()
        self.figures: dict[str, Any] = {"states": 0, "targets": 0, "failed": []}
        self._threads = [
            threading.Thread(target=self._work, args=(number == 0,))
            for number in range(order["count"])
        ]
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Close them all."""
        self._ended.set()
        for thread in self._threads:
            thread.join()

    def _work(self, steers: bool) -> None:
        states = targets = 0
        try:
            with self._connected() as connection:
                if steers:
                    connection.acquire(PATIENCE_S)
                began = due = time.monotonic()
                while not self._ended.is_set():
                    time.sleep(max(0.0, due - time.monotonic()))  # cheaper than an event's wait
                    due += self._period_s
                    connection.state()
                    states += 1
                    if steers:
                        angle = 2.0 * math.pi * (time.monotonic() - began) / ROUND_S
                        x, y, z = CENTRE_M
                        aim = x + RADIUS_M * math.sin(angle), y, z + RADIUS_M * math.cos(angle)
                        with suppress(UsageError):  # the robot does not follow yet, or any more
                            connection.send_target(aim)
                            targets += 1
        except Hoap3Error as error:
            if not states:  # else it is the robot that ended
                self.figures["failed"].append(str(error))
        finally:
            with self._lock:
                self.figures["states"] += states
                self.figures["targets"] += targets

    def _connected(self) -> Connection:
        """A connection, as soon as the robot answers."""
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                return connect(self._robot, self._endpoint)
            except Hoap3Error:
                if time.monotonic() > until or self._ended.wait(0.2):
                    raise


def main() -> int:
    """Be clients until the lifeline is cut; what they did goes to standard output as JSON."""
    lifeline, order = Lifeline(), read_order()
    print("ready", flush=True)
    clients = Clients(order)
    while not lifeline.cut():
        time.sleep(0.05)
    clients.end()
    json.dump(clients.figures, sys.stdout)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
