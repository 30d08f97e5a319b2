"""The live page of a robot with certificates: it may what the certificate behind it may."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.certificates.secured_arm import assert_stays
from support.command_bench import Command
from support.pages.steered_arm import FAR, HOME, ROBOT, address, goes_to, hand, steer
from support.pages.view_bench import page

import hoap3

pytestmark = pytest.mark.slow

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
        assert pen.hear("frame", mode="stopped")
        assert pen.act(verb="recover")["error"]  # an admin does that
        robot.recover()
        assert pen.hear("frame", mode="active")


def test_with_an_observers_certificate_a_page_sees_all_and_does_nothing(secured, certs):
    with (
        view(secured, certs / "otto") as command,
        page(*address(command)) as pen,
        hoap3.connect(ROBOT, secured, secure=certs / "otto") as robot,
    ):
        assert pen.prove()
        place = hand(robot.state())
        shown = pen.hear("frame")
        assert len(shown["q"]) == robot.description.n
        for do in DEEDS:
            told = pen.act(**do)
            assert told["error"], json.dumps(do)
        assert_stays(robot, place)
        assert robot.changeable()["tasks"]["hand"]["gain_per_s"] == 10.0
        assert pen.hear("frame")["tick"] > shown["tick"]
