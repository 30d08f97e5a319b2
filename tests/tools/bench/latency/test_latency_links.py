"""Links that can be measured: both sides find each other over each, on loopback only."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import UsageError
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink
from hoap3.protocol.link.zenoh_session import session_name
from hoap3.tools.bench.latency.latency import secured
from hoap3.tools.machine.loopback_links import ZENOH, link

PATIENCE_S = 60.0


@pytest.mark.parametrize("name", ZENOH)
def test_a_robot_and_its_controller_meet(name):
    with link(name) as (ours, theirs):
        for endpoint in (*ours["listen"], *theirs["connect"]):
            protocol, _, place = endpoint.partition("/")
            assert protocol == {"unixsock": "unixsock-stream"}.get(name, name)
            assert place.startswith(("127.0.0.1:", "/"))
        robot = ZenohRobotLink("meeting", LinkSettings().model_copy(update=ours))
        try:
            controller = ZenohControllerLink(
                "meeting", LinkSettings().model_copy(update=theirs), "somebody"
            )
            try:
                assert controller.presence.wait(PATIENCE_S)
            finally:
                controller.close()
        finally:
            robot.close()


def test_with_certificates_both_sides_meet_and_nothing_is_left_behind():
    with secured("meeting") as (ours, theirs):
        robot = ZenohRobotLink("meeting", LinkSettings().model_copy(update=ours))
        try:
            settings = LinkSettings().model_copy(update=theirs)
            who = session_name(settings, "1")
            controller = ZenohControllerLink("meeting", settings, who)
            try:
                assert controller.presence.wait(PATIENCE_S)
            finally:
                controller.close()
        finally:
            robot.close()
    assert not Path(ours["secure"]).exists()


def test_nothing_of_a_link_is_left_behind():
    with link("unixsock") as (ours, _):
        folder = Path(ours["listen"][0].removeprefix("unixsock-stream")).parent
        assert folder.is_dir()
    assert not folder.exists()


def test_an_unknown_link_is_refused():
    with pytest.raises(UsageError, match="'pigeon'"), link("pigeon"):
        pass
