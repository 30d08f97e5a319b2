"""A client that asks for authority and dies meanwhile does not keep it, however late the robot is.

The robot's process is stopped while another process asks and is killed. So the request and the
news of the client's end are there at the same time when the robot goes on.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support import HOUSE
from support.command_bench import PATIENT, QUIET, Command, emulator, endpoint

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import ask, key, open_session

CLIENT = Path(__file__).parent / "dying_client.py"
LEASE_S = LinkSettings().lease_ms / 1e3
WAITING = 48  # requests in front of that of the dying client; the robot's queue takes 64
TRIALS = 100
AGAIN_S = 0.02
GIVE_UP_S = 3 * LEASE_S


class Attack:
    """One robot, and clients that die while it is held up."""

    def __init__(self, robot: Command, at: str) -> None:
        self._robot, self._at = robot, at
        settings = LinkSettings(connect=(at,), mode="client")
        self._session = open_session(settings)
        self._token = self._session.liveliness().declare_token(key("hoap3", "clients/next"))

    def close(self) -> None:
        self._session.close()

    def refused_for(self, name: str, when: str, held_s: float, queue: int) -> float:
        """Seconds after which the next client still asked in vain; infinite where it always did.

        The time is that of the request, so a machine too busy to answer soon changes nothing.

        Args:
            name: of the client that dies.
            when: it declares its token, "early" or "late".
            held_s: for how long the robot's process is stopped [s].
            queue: requests of others that are in front of the client's.
        """
        with subprocess.Popen(
            [sys.executable, str(CLIENT), self._at, "hoap3", name, when],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"PYTHONPATH": str(HOUSE)},
        ) as client:
            assert client.stdout.readline() == b"ready\n"
            self._robot.send(signal.SIGSTOP)
            try:
                end = time.monotonic() + held_s
                waiting = [
                    self._session.get(key("hoap3", "ask/status"), payload=b"next")
                    for _ in range(queue)
                ]
                client.stdin.write(b"\n")
                client.stdin.flush()
                assert client.stdout.readline() == b"asked\n"
                client.kill()
                client.wait()
                time.sleep(max(0.0, end - time.monotonic()))
            finally:
                self._robot.send(signal.SIGCONT)
        began = time.monotonic()
        del waiting
        return self._until_granted(began, name)

    def _until_granted(self, began: float, name: str) -> float:
        refused = 0.0
        while (asked := time.monotonic() - began) < GIVE_UP_S:
            answer = json.loads(ask(self._session, "hoap3", "acquire", "next") or b"{}")
            if answer.get("granted"):
                ask(self._session, "hoap3", "release", "next")
                ask(self._session, "hoap3", "recover", "next")
                return refused
            refused = asked
            time.sleep(AGAIN_S)
        ask(self._session, "hoap3", "release", name)  # so that the next trial starts as this one
        ask(self._session, "hoap3", "recover", "next")
        return float("inf")


@pytest.fixture
def attack() -> Iterator[Attack]:
    at = endpoint()
    with emulator("hoap3", *PATIENT, *QUIET, at=at) as robot:
        made = Attack(robot, at)
        yield made
        made.close()


@pytest.mark.long
@pytest.mark.parametrize("queue", [0, WAITING])
@pytest.mark.parametrize("when", ["early", "late"])
def test_the_next_client_is_granted_within_the_lease(attack, when, queue):
    held = random.Random(queue)
    waits = [
        attack.refused_for(f"dead{trial}", when, held.uniform(0.005, 0.2), queue)
        for trial in range(TRIALS)
    ]
    late = sum(wait > LEASE_S for wait in waits)
    print(f"{late} of {TRIALS} beyond the lease; last refusal after {max(waits):.3f} s")
    assert late == 0
