"""The ring between two processes: what a loop and its observer do."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ring_reader import body

from hoap3.protocol.runtime.shm_ring import Kind, Ring

SLOTS, SLOT_BYTES = 64, 1024
CAPACITY = SLOT_BYTES - 32
HERE = Path(__file__).parent
SIZES = (8, 800, 5 * CAPACITY // 8 * 8)  # the last one needs several slots


@pytest.fixture
def ring() -> Iterator[Ring]:
    made = Ring(slots=SLOTS, slot_bytes=SLOT_BYTES)
    yield made
    os.close(made.fd)


@pytest.fixture
def start(ring):
    """Starts a reader of the ring and waits until it is there."""
    started: list[subprocess.Popen] = []

    def starting(*arguments: str) -> subprocess.Popen:
        child = subprocess.Popen(
            [sys.executable, str(HERE / "ring_reader.py"), str(ring.fd), *arguments],
            pass_fds=(ring.fd,),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(HERE.parent.parent)},
            text=True,
        )
        started.append(child)
        assert child.stdout.readline() == "ready\n"
        return child

    yield starting
    for child in started:
        child.kill()
        child.communicate()


def test_a_reader_in_another_process_loses_nothing_and_sees_whole_payloads(ring, start):
    reader = start()
    count = 3000
    for number in range(count):
        size = SIZES[number % len(SIZES)]
        slots = -(-size // CAPACITY)
        while ring.room(Kind.STATE) < slots:
            assert reader.poll() is None
            os.sched_yield()
        assert ring.write(Kind.STATE, number, body(number, size))
    ring.close()
    report = json.loads(reader.stdout.read())
    assert report == {"found": count, "gaps": 0, "broken": 0}


def test_what_a_reader_misses_is_what_was_dropped(ring, start):
    reader = start()
    count = 20_000
    written = sum(ring.write(Kind.EVENT, number, body(number, 800)) for number in range(count))
    while ring.free < SLOTS:  # so that the last record cannot be dropped, and tells of all gaps
        assert reader.poll() is None
        os.sched_yield()
    written += ring.write(Kind.EVENT, count, body(count, 8))
    ring.close()
    report = json.loads(reader.stdout.read())
    assert report == {"found": written, "gaps": ring.dropped, "broken": 0}
    assert written + ring.dropped == count + 1


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_writer_does_not_notice_a_reader_that_is_killed_or_stopped(ring, start, how):
    for number in range(10):
        ring.write(Kind.EVENT, number, body(number, 8))
    reader = start("hang")
    assert reader.stdout.readline() == "10\n"
    os.kill(reader.pid, how)
    os.waitid(os.P_PID, reader.pid, os.WEXITED | os.WSTOPPED | os.WNOWAIT)
    written = [ring.write(Kind.EVENT, number, body(number, 8)) for number in range(10 * SLOTS)]
    assert written == [True] * SLOTS + [False] * (9 * SLOTS)
    assert ring.dropped == 9 * SLOTS


def test_a_new_reader_goes_on_where_the_killed_one_stopped(ring, start):
    ring.write(Kind.EVENT, 0, body(0, 8))
    first = start("hang")
    assert first.stdout.readline() == "1\n"
    first.kill()
    first.wait()
    for number in range(1, SLOTS + 5):
        ring.write(Kind.EVENT, number, body(number, 8))
    ring.close()
    second = start()
    report = json.loads(second.stdout.read())
    assert report == {"found": SLOTS, "gaps": 0, "broken": 0}
    assert ring.dropped == 4
