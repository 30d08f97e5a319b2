"""`hoap3 bridge` before a robot is there, and without what it needs."""

from __future__ import annotations

import signal
import socket
import sys

import pytest
from looked_at import assert_ends
from support.command_bench import Command, endpoint, free_port, inside


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)  # as if it were not installed
    done = inside("bridge", "foxglove", "--port", 0)
    assert done.code == 2
    assert "pip install 'hoap3[foxglove]'" in done.stderr


def test_a_taken_port_is_an_error_before_any_robot_is_looked_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for words in (("foxglove", "--port", port), ("ros2", "--listen", f"tcp/127.0.0.1:{port}")):
            done = inside("bridge", *words)
            assert done.code == 2
            assert words[1] in done.stderr
            assert str(port) in done.stderr


def test_an_endpoint_that_is_none_is_an_error_and_not_waited_for() -> None:
    done = inside("bridge", "foxglove", "--port", 0, "--connect", "127.0.0.1:7447")
    assert done.code == 2
    assert "tcp/127.0.0.1:7447" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["foxglove", "ros2"])
def test_it_says_that_no_robot_is_there_waits_and_ends_in_order(kind: str) -> None:
    place = ("--port", "0") if kind == "foxglove" else ("--listen", endpoint())
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    with Command("bridge", kind, *place, "--connect", nowhere) as bridge:
        bridge.wait_for("waiting")
        assert not bridge.ended_within(0.5)
        assert_ends(bridge, signal.SIGTERM)
