"""Links that can be measured: both sides find each other over each, on loopback only."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from hoap3.protocol.config.settings import LinkSettings, RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink
from hoap3.tools.machine.loopback_links import LINKS, link, self_signed

ORDINARY = RealtimeSettings(policy="none", cpu="none", lock_memory=False)
PATIENCE_S = 60.0


@pytest.mark.parametrize("name", LINKS)
def test_a_robot_and_its_controller_meet(name):
    with link(name, ORDINARY) as (ours, theirs):
        for endpoint in (*ours.get("listen", ()), *theirs["connect"]):
            protocol, _, place = endpoint.partition("/")
            assert protocol == {"unixsock": "unixsock-stream", "router": "tcp"}.get(name, name)
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


def test_a_certificate_is_for_loopback_and_for_a_day(tmp_path):
    key, certificate = self_signed(tmp_path)
    shown = subprocess.run(
        ["openssl", "x509", "-in", certificate, "-noout", "-text"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "IP Address:127.0.0.1" in shown
    assert "CA:FALSE" in shown
    assert key.stat().st_mode & 0o077 == 0


def test_nothing_of_a_link_is_left_behind():
    with link("tls", ORDINARY) as (ours, _):
        key = ours["listen"][0].partition("listen_private_key_file=")[2].partition(";")[0]
        assert Path(key).read_text().startswith("-----BEGIN")
    assert not Path(key).exists()


def test_what_is_missing_is_said(monkeypatch, tmp_path):
    with pytest.raises(UsageError, match="no link is called 'pigeon'"), link("pigeon", ORDINARY):
        pass
    monkeypatch.setattr("hoap3.tools.machine.loopback_links.shutil.which", lambda _: None)
    with pytest.raises(UsageError, match="openssl is missing"), link("tls", ORDINARY):
        pass
    monkeypatch.setattr("hoap3.tools.machine.loopback_links.shutil.which", lambda _: "/bin/false")
    with pytest.raises(Hoap3Error, match="openssl made no certificate"):
        self_signed(tmp_path)
