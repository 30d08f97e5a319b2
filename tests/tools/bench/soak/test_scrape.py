"""What a service tells over HTTP, and doors at which nothing answers as he should."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from support.command_bench import free_port

from hoap3.tools.bench.soak.watch import FAILURES, scrape

FIGURES = """# TYPE hoap3_states counter
hoap3_states_total{side="robot",robot="ur5"} 12
# TYPE hoap3_events counter
hoap3_events_total{side="robot",robot="ur5",kind="CLIPPED"} 3
# TYPE hoap3_rtt_seconds histogram
hoap3_rtt_seconds_bucket{side="robot",robot="ur5",le="+Inf"} 4
hoap3_rtt_seconds_count{side="robot",robot="ur5"} 4
hoap3_rtt_seconds_sum{side="robot",robot="ur5"} 0.5
"""
PAGES = {"figures": (200, FIGURES), "refused": (503, ""), "noise": (200, "}{ 1")}


@pytest.fixture
def door(request: pytest.FixtureRequest) -> Iterator[int]:
    """Port of a server that answers with one of the pages."""
    status, text = PAGES[request.param]

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with HTTPServer(("127.0.0.1", 0), Page) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("door", ["figures"], indirect=True)
def test_figures_without_labels_of_their_own_are_taken(door):
    found = scrape("127.0.0.1", door)
    assert found == {"states_total": 12.0, "rtt_seconds_count": 4.0, "rtt_seconds_sum": 0.5}


@pytest.mark.parametrize("door", ["refused", "noise"], indirect=True)
def test_an_answer_that_is_none_is_a_failure(door):
    with pytest.raises(FAILURES):
        scrape("127.0.0.1", door)


def test_nobody_at_the_door_is_a_failure():
    with pytest.raises(FAILURES):
        scrape("127.0.0.1", free_port())
