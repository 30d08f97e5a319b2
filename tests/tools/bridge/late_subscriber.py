"""A client that asks for a channel which is gone, while a robot begins anew: a program.

Whoever logs through Python is held up meanwhile: a server that logs with locks in its hands, and
closes channels, stands still for ever, and with it all of this process.
"""

from __future__ import annotations

import logging
import threading

from foxglove_client import FoxgloveClient
from support.small_arm import arm

from hoap3.protocol.messages import State
from hoap3.tools.bridge.foxglove_server import FoxgloveServer

ROBOT = arm()
STATES = f"/robots/{ROBOT.name}/state"
PLACE = "tcp/127.0.0.1:1"


class HeldUp(logging.Handler):
    """Logs slowly, until the robot has begun anew."""

    def __init__(self) -> None:
        super().__init__()
        self.logs, self.begun = threading.Event(), threading.Event()

    def emit(self, record: logging.LogRecord) -> None:
        """Wait, without Python's lock."""
        del record
        self.logs.set()
        self.begun.wait(2.0)


def main() -> None:
    """See the robot's third run."""
    slow = HeldUp()
    logging.getLogger().addHandler(slow)
    state = State.allocate(**ROBOT.state_lengths)
    server = FoxgloveServer("127.0.0.1", 0)
    with FoxgloveClient(server.port) as client:
        server.begin(ROBOT, PLACE)
        client.wait_for(lambda: STATES in client.channels)
        gone = list(client.channels.values())
        server.begin(ROBOT, PLACE)
        client.look_at(gone)  # it has not heard yet that they are closed
        client.wait_for(lambda: slow.logs.is_set() or client.status)
        server.begin(ROBOT, PLACE)
        slow.begun.set()
        client.look_at_all()
        client.wait_for(
            lambda: client.messages.get(STATES), lambda: server.state(state.dump(), state)
        )
    server.close()


if __name__ == "__main__":
    main()
