"""A robot that runs while its list changes and certificates end: who goes, and who stays."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from support.certificates.laboratory import client, laboratory
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    assert_no_traceback,
    emulator,
    endpoint,
    events,
    followed,
)

import hoap3
from hoap3.protocol.link.zenoh_link import ZenohControllerLink
from hoap3.protocol.link.zenoh_session import session_name
from hoap3.protocol.secure.access import read_access
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.tools.logs.log import Log
from hoap3.tools.services.certificates import renew, revoke
from hoap3.tools.services.connection import Connection

pytestmark = pytest.mark.slow

RELOADS = 8
HALF = 500  # ticks, of which the first such after a reload has the look at the list in it


@pytest.fixture
def certs(tmp_path) -> Path:
    return laboratory(tmp_path / "certs", "hoap3")


@pytest.fixture
def at() -> str:
    return endpoint().replace("tcp/", "tls/")


def until_tick(seen: Connection, tick: int) -> Iterator[int]:
    """Ticks that are seen until one is over; those of one session."""
    for state in seen.states(PATIENCE_S):
        yield state.tick
        if state.tick >= tick:
            return


def until_mode(seen: Connection, mode: str) -> None:
    for _ in until_tick(seen, 10**9):
        if seen.status()["mode"] == mode:
            return


def test_a_holder_that_is_revoked_goes_and_nobody_else_notices(certs, at, tmp_path):
    out, begins = tmp_path / "log", []
    robot, law = ("--secure", certs / "hoap3"), ("--secure", certs / "qp")
    with followed(at, robot=(*PATIENT, "--out", out, *robot), law=(*QUIET, *law)) as (ours, theirs):
        file = certs / "hoap3" / "access.yaml"
        with hoap3.connect("hoap3", at, secure=certs / "otto") as seen:
            until_mode(seen, "active")
            listed = read_access(file.parent)
            for turn in range(RELOADS):
                begins.append(seen.status()["tick"])
                access = listed if turn % 2 else listed.without("anna")
                file.write_text(access.to_yaml(), encoding="utf-8")
                for _ in until_tick(seen, begins[-1] + 2 * HALF):
                    continue
            ours.wait_for("lets in no longer: anna", RELOADS // 2)
            assert seen.status()["mode"] == "active"
            revoked = seen.status()["tick"]
            revoke(certs, "qp")
            ours.wait_for("lets in no longer: qp")
            ours.wait_for(r"holder lost \(epoch \d+\)")
            assert seen.status()["holder"] is None
            gone = seen.status()["tick"]
            for _ in until_tick(seen, gone + HALF):  # on the connection that it had before
                continue
            assert seen.status()["holder"] is None  # it does not come back
            until_mode(seen, "stopped")
        assert theirs.end(signal.SIGTERM) == 0
        assert ours.end(signal.SIGTERM) == 1  # there was a safe stop
        assert_no_traceback(ours)
    log = Log.open(out, side="robot")
    assert "SAFE_STOP" in dict(events(log))
    states = log.states()
    ticks, skipped = states["tick"], states["skipped"]
    ends = [np.searchsorted(ticks, [tick, tick + HALF, tick + 2 * HALF]) for tick in begins]
    counts = np.array([np.diff(skipped[places].astype(int)) for places in ends])
    for what, each in zip(("with a reload", "after that"), counts.T, strict=True):
        print(f"skipped in {HALF} ticks {what}: {each.tolist()}, sum {each.sum()}")
    print(f"revoked after tick {revoked}, without a holder before tick {gone}")


def test_a_holder_whose_certificate_ends_goes_and_stays_away(certs, at):
    with emulator("hoap3", *QUIET, *PATIENT, "--secure", certs / "hoap3", at=at) as ours:
        renew(certs, "qp", timedelta(seconds=8))
        settings = client(certs, "qp", at, "peer")
        ends = read_credentials(certs / "qp").expires
        link = ZenohControllerLink("hoap3", settings, session_name(settings, "1"))
        with hoap3.connect("hoap3", at, secure=certs / "otto") as seen:
            assert link.presence.wait(PATIENCE_S)
            while b'"granted": true' not in (link.ask("acquire") or b""):
                assert datetime.now(UTC) < ends, "it took too long"
            ours.wait_for(r"holder lost \(epoch \d+\)")
            assert datetime.now(UTC) >= ends
            assert link.ask("acquire") is None
            gone = seen.status()["tick"]
            for _ in until_tick(seen, gone + HALF):  # on the connection that it had before
                continue
            assert seen.status()["holder"] is None
        link.close()
        assert ours.end(signal.SIGTERM) == 1  # there was a safe stop
        assert_no_traceback(ours)
