"""What is told to systemd, and where it is told."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.systemd.stand_in import SystemdStandIn

from hoap3.protocol.errors import UsageError
from hoap3.tools.services.systemd_notify import Notifier, NotifySettings


@pytest.fixture(params=["file", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path):
    where = tmp_path / "notify" if request.param == "file" else f"@hoap3-test-{os.getpid()}"
    with SystemdStandIn(where) as made:
        yield made


def test_facts_arrive_as_lines_of_one_datagram(systemd: SystemdStandIn) -> None:
    notifier = Notifier(systemd.address)
    assert notifier.send(READY="1", STATUS="two\nlines")
    assert systemd.wait_for(lambda: len(systemd.heard) == 2)
    assert systemd.heard == ["READY=1", "STATUS=two lines"]
    notifier.close()


def test_what_does_not_arrive_is_said_and_harms_nobody(tmp_path: Path) -> None:
    notifier = Notifier(str(tmp_path / "nobody"))
    assert not notifier.send(READY="1")
    with SystemdStandIn(tmp_path / "nobody"):
        assert notifier.send(READY="1")
    notifier.close()


def test_a_service_that_nobody_of_systemd_started_tells_nothing() -> None:
    assert NotifySettings.of({}) is None
    assert NotifySettings.of({"NOTIFY_SOCKET": "", "WATCHDOG_USEC": "1"}) is None


@pytest.mark.parametrize(("told", "expected"), [({}, None), ({"WATCHDOG_USEC": "1500000"}, 1.5)])
def test_where_systemd_listens_and_how_often(told: dict[str, str], expected: float | None) -> None:
    found = NotifySettings.of({"NOTIFY_SOCKET": "/run/notify", **told})
    assert found == NotifySettings("/run/notify", expected)


@pytest.mark.parametrize(
    "environment",
    [
        {"NOTIFY_SOCKET": "vsock:2:1"},
        {"NOTIFY_SOCKET": "/run/notify", "WATCHDOG_USEC": "soon"},
        {"NOTIFY_SOCKET": "/run/notify", "WATCHDOG_USEC": "0"},
        {"NOTIFY_SOCKET": "/run/notify", "WATCHDOG_USEC": "-5"},
    ],
)
def test_what_makes_no_sense_is_refused_by_its_name(environment: dict[str, str]) -> None:
    name, value = list(environment.items())[-1]
    with pytest.raises(UsageError, match=f"{name}={value}"):
        NotifySettings.of(environment)
