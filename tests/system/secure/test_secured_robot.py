"""`hoap3.connect` to a robot with certificates: targets and chunks by an operator's alone."""

from __future__ import annotations

import numpy as np
import pytest
from support.certificates.secured_arm import assert_stays, goes
from support.pages.steered_arm import FAR, HOME, ROBOT, hand

import hoap3
from hoap3.protocol.errors import LinkError, UsageError
from hoap3.protocol.link import zenoh_session as network
from hoap3.tools.services import connection

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
            monkeypatch.setattr(connection, "check_right", lambda *_, **__: None)
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
