"""Robots with certificates: who steers them, from Python and from the page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.certificates.secured_arm import assert_stays, goes
from support.command_bench import Command
from support.pages.steered_arm import FAR, HOME, ROBOT, address, goes_to, hand, steer
from support.pages.view_bench import page

import hoap3
from hoap3.protocol.errors import LinkError, UsageError
from hoap3.protocol.link import zenoh_session as network
from hoap3.tools.services import client

pytestmark = pytest.mark.slow

STEP_TICKS, POINTS = 50, 60


def test_an_operator_steers_by_targets_and_by_chunks(secured, certs):
    with hoap3.connect(ROBOT, secured, secure=certs / "anna") as robot:
        robot.acquire(timeout_s=60.0)
        robot.send_target(FAR)
        goes(robot, FAR)
        share = (1.0 - np.cos(np.linspace(0.0, np.pi, POINTS))) / 2.0
        way = np.array(FAR) + share[:, None] * np.subtract(HOME, FAR)
        robot.send_chunk(way, robot.state().tick + STEP_TICKS, STEP_TICKS)
        goes(robot, HOME)
        counts = robot.counts()
        assert (counts["taken"], counts["refused"]) == (2, {})
        robot.release()


@pytest.mark.parametrize("name", ["otto", "rival", "chief"])
def test_nobody_else_does_even_without_the_checks_of_the_client(name, secured, certs, monkeypatch):
    with hoap3.connect(ROBOT, secured, secure=certs / "anna") as operator:
        operator.acquire(timeout_s=60.0)
        granted = operator._held()
        place = hand(operator.state())
        with hoap3.connect(ROBOT, secured, secure=certs / name) as robot:
            with pytest.raises(UsageError):
                robot.acquire()
            monkeypatch.setattr(client, "check_right", lambda *_, **__: None)
            with pytest.raises((LinkError, UsageError)):
                robot.acquire()
            with pytest.raises((LinkError, UsageError)):
                robot.change({"tasks.hand.gain_per_s": 5.0})
            robot._operator = granted  # under the operator's epoch
            robot.send_target(FAR)
            robot._targets = robot._session.declare_publisher(
                network.key(ROBOT, f"targets/{operator.who}")
            )
            robot.send_target(FAR)
            robot._operator = None
            assert_stays(robot, place)
            assert robot.changeable()["tasks"]["hand"]["gain_per_s"] == 10.0
        assert operator.counts()["refused"] == {}
        operator.release()


DEEDS = (
    {"verb": "acquire"},
    {"verb": "target", "name": "hand", "values": FAR},
    {"verb": "velocity", "name": "hand", "values": [0.1, 0.1, 0.1]},
    {"verb": "change", "what": {"tasks.hand.gain_per_s": 5.0}},
    {"verb": "stop"},
    {"verb": "recover"},
)


def view(at: str, directory: Path) -> Command:
    return Command("view", ROBOT, "--connect", at, "--secure", directory, "--port", 0)


def test_with_an_operators_certificate_a_page_moves_the_robot_and_stops_it(secured, certs):
    with (
        view(secured, certs / "anna") as command,
        page(*address(command)) as pen,
        hoap3.connect(ROBOT, secured, secure=certs / "chief") as robot,
    ):
        steer(pen)
        goes_to(robot, pen, FAR)
        goes_to(robot, pen, HOME)
        assert pen.act(verb="release")["error"] is None
        assert pen.act(verb="stop")["error"] is None
        assert pen.wait_for("frame", mode="stopped")
        assert pen.act(verb="recover")["error"]  # an admin does that
        robot.recover()
        assert pen.wait_for("frame", mode="active")


def test_with_an_observers_certificate_a_page_sees_all_and_does_nothing(secured, certs):
    with (
        view(secured, certs / "otto") as command,
        page(*address(command)) as pen,
        hoap3.connect(ROBOT, secured, secure=certs / "otto") as robot,
    ):
        assert pen.prove()
        place = hand(robot.state())
        shown = pen.wait_for("frame")
        assert len(shown["q"]) == robot.description.n
        for do in DEEDS:
            told = pen.act(**do)
            assert told["error"], json.dumps(do)
        assert_stays(robot, place)
        assert robot.changeable()["tasks"]["hand"]["gain_per_s"] == 10.0
        assert pen.wait_for("frame")["tick"] > shown["tick"]
