"""Figures of a running robot over HTTP; a port that is taken, which its loop does not notice."""

from __future__ import annotations

import signal
import socket
import urllib.request
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families
from support.certificates.laboratory import laboratory
from support.command_bench import (
    PATIENT,
    QUIET,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    free_port,
    wait_for_mode,
    wait_for_ticks,
)

from hoap3.protocol.secure.credentials import read_credentials

pytestmark = pytest.mark.slow


def scrape(port: int) -> dict[str, float]:
    """Figures without labels of their own."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        families = text_string_to_metric_families(answer.read().decode())
    return {
        sample.name: sample.value
        for family in families
        for sample in family.samples
        if sample.labels.keys() == {"side", "robot"}
    }


def test_both_sides_serve_figures_that_grow(tmp_path: Path) -> None:
    at, ports = endpoint(), (free_port(), free_port())
    kept = ("--out", tmp_path, *PATIENT, "--set", f"metrics.port={ports[0]}")
    with (
        emulator("hoap3", *kept, at=at) as robot,
        controller("qp12", *QUIET, "--set", f"metrics.port={ports[1]}", at=at) as law,
    ):
        wait_for_mode("active", at)
        robot.wait_for("metrics at http://127.0.0.1")
        law.wait_for("metrics at http://127.0.0.1")
        before = scrape(ports[0])
        wait_for_ticks(at, 500)
        after = scrape(ports[0])
        asked = [
            found["hoap3_deadlines_met_total"] + found["hoap3_deadlines_missed_total"]
            for found in (before, after)
        ]
        assert asked[1] > asked[0]  # by how much depends on the load of the machine
        assert after["hoap3_authority_epoch"] == 1
        assert after["hoap3_log_lost"] == 0
        assert after["hoap3_log_free_bytes"] > 0
        assert scrape(ports[1])["hoap3_setpoints_total"] > 0
        assert law.end(signal.SIGTERM) == 0
        robot.end(signal.SIGTERM)
        for service in (robot, law):
            service.assert_no_orphan()


def test_a_port_that_is_taken_costs_the_metrics_alone() -> None:
    at = endpoint()
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        emulator(
            *("hoap3", *QUIET, *PATIENT, "--json"),
            *("--set", f"metrics.port={taken.getsockname()[1]}"),
            at=at,
        ) as robot,
        controller("qp12", *QUIET, at=at) as law,
    ):
        robot.wait_for("metrics are not served: Address already in use")
        wait_for_mode("active", at)
        wait_for_ticks(at, 200)
        assert robot.end(signal.SIGTERM) == 1
        assert len(robot.json()["metrics_lost"]) == 1
        assert robot.json()["log_lost"] == []
        assert law.end(signal.SIGTERM) == 0
        assert_no_traceback(robot)


def test_a_robot_with_a_certificate_serves_its_end(tmp_path: Path) -> None:
    certs, at, port = laboratory(tmp_path, "hoap3"), endpoint().replace("tcp/", "tls/"), free_port()
    words = ("--secure", certs / "hoap3", "--set", f"metrics.port={port}")
    with emulator("hoap3", *QUIET, *words, at=at) as robot:
        robot.wait_for("metrics at http://127.0.0.1")
        ends = read_credentials(certs / "hoap3").expires.timestamp()
        assert scrape(port)["hoap3_certificate_expiry_seconds"] == ends
        assert robot.end(signal.SIGTERM) == 0
