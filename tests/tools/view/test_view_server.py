"""The server over loopback: what it gives, to whom, and what strange pages come to."""

from __future__ import annotations

import asyncio
import http.client
import json
import math
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise

import pytest
from support.pages.view_bench import NotingOperator, PagePen, Served, StillSource, page
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hoap3.protocol.errors import PortInUseError
from hoap3.tools.view import page as page_module
from hoap3.tools.view import server as server_module
from hoap3.tools.view.access import new_token
from hoap3.tools.view.page import AHEAD
from hoap3.tools.view.server import PageServer

DIGEST = "ab" * 32


@pytest.fixture
def served() -> Iterator[Served]:
    with Served(StillSource(), NotingOperator(), new_token()) as server:
        yield server


@pytest.fixture
def pen(served: Served) -> Iterator[PagePen]:
    """A page that has proved that it knows the token."""
    with page(served.host, served.token) as found:
        assert found.prove()
        yield found


def get(host: str, path: str, **headers: str) -> http.client.HTTPResponse:
    address, _, port = host.rpartition(":")
    connection = http.client.HTTPConnection(address, int(port), timeout=30)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_the_address_holds_the_token_where_no_request_does(served):
    assert served.url == f"http://{served.host}/#{served.token}"


def test_every_module_that_the_page_imports_is_served(served):
    waiting, seen = ["/page.js"], set()
    while waiting:
        path = waiting.pop()
        answer = get(served.host, path)
        assert answer.status == 200, path
        assert answer.headers["Content-Type"].startswith("text/javascript")
        seen.add(path)
        source = answer.read().decode()
        if path != "/vendor.js":
            found = re.findall(r"""from ["']\./([a-z]+\.js)["']""", source)
            waiting += [f"/{name}" for name in found if f"/{name}" not in seen]
    assert len(seen) > 10


def test_what_is_not_listed_is_not_there(served):
    outside = "/..", "/../access.py", "//etc/passwd", "/%2e%2e/x"
    for path in (*outside, "/static/page.js", "/page.py"):
        assert get(served.host, path).status == 404
    served.source.meshes[DIGEST] = b"mesh"
    assert get(served.host, f"/mesh/{DIGEST}").read() == b"mesh"
    for digest in ("cd" * 32, "../" + DIGEST, DIGEST.upper(), DIGEST + "0", ""):
        assert get(served.host, f"/mesh/{digest}").status == 404


def test_nothing_from_elsewhere_may_be_loaded_by_a_page(served):
    served.source.meshes[DIGEST] = b"mesh"
    answer = get(served.host, f"/mesh/{DIGEST}")
    policy = answer.headers["Content-Security-Policy"]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == rules["frame-ancestors"] == "'none'"
    assert rules["script-src"] == rules["style-src"] == "'self'"
    assert rules["connect-src"] == f"'self' ws://{served.host}"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_a_name_of_somebodys_dns_is_refused(served):
    for host in ("evil.example", f"evil.example:{served.host.rpartition(':')[2]}"):
        assert get(served.host, "/", Host=host).status == 403
    with pytest.raises(InvalidStatus, match="403"):
        connect(
            f"ws://{served.host}/socket",
            origin="http://evil.example",
            additional_headers={"Host": "evil.example"},
        )


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1", None])
def test_a_page_of_somebody_else_sees_nothing(served, origin):
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://{served.host}/socket", origin=origin)


def test_a_page_is_greeted_and_then_shown_frames(served):
    with page(served.host) as seen:
        assert seen.hello["robot"] == "still"
        assert seen.hello["writes"]
        ticks = [seen.wait_for("frame")["tick"] for _ in range(5)]
        assert ticks == sorted(set(ticks))
    with page(served.host) as other:
        assert other.nonce != seen.nonce


@pytest.mark.slow
def test_no_more_than_30_frames_a_second_are_sent(served):
    with page(served.host) as seen:
        first = seen.wait_for("frame")
        begin = time.monotonic()
        for _ in range(45):
            last = seen.wait_for("frame")
        took = time.monotonic() - begin
    assert last["tick"] - first["tick"] >= 45
    assert took >= 44 / server_module.RATE_HZ


def test_who_proves_the_token_is_obeyed_and_nobody_else(served):
    with page(served.host, served.token) as pen:
        told = pen.act(verb="stop")
        assert told["error"]
        assert not served.operator.done
        assert pen.prove()
        assert pen.act(verb="stop")["error"] is None
        assert served.operator.done == [{"verb": "stop"}]
    with page(served.host, "guess") as stranger:
        assert not stranger.prove()
        assert stranger.act(verb="stop")["error"]
        assert len(served.operator.done) == 1


def test_what_was_recorded_is_of_no_use(served, pen):
    text = json.dumps({"verb": "stop"})
    word = {"kind": "act", "id": 1, "mac": pen.mac(1, text), "do": text}
    proof = {"kind": "prove", "proof": pen.code(pen.nonce + pen.origin)}
    pen.say(**word)
    assert pen.wait_for("told", id=1)["error"] is None
    pen.say(**word)
    assert pen.wait_for("told", id=1)["error"]
    changed = {**word, "id": 2}
    pen.say(**changed)
    assert pen.wait_for("told", id=2)["error"]
    with page(served.host) as thief:
        thief.say(**proof)
        assert not thief.wait_for("proved")["ok"]
        thief.say(**word)
        assert thief.wait_for("told", id=1)["error"]
    assert len(served.operator.done) == 1


def test_beats_count_for_who_knows_the_token(served):
    with page(served.host, served.token) as pen:
        pen.beat()
        pen.wait_for("told", id=1)
        assert not served.operator.beats
        pen.prove()
        pen.beat()
        pen.act(verb="stop")
        assert served.operator.beats == 1


def test_targets_are_taken_in_their_order_however_fast_they_come(served, pen):
    numbers = [pen.send(verb="target", name="hand", values=[i, 0, 0]) for i in range(100)]
    for number in numbers:
        assert pen.wait_for("told", id=number)["error"] is None
    assert [do["values"][0] for do in served.operator.done] == list(range(100))


def test_a_page_that_goes_is_noticed(served):
    with page(served.host):
        pass
    assert served.operator.gone.wait(30)


WRONG = (
    "",
    "no JSON",
    "[]",
    "null",
    "7",
    "{}",
    '{"kind": 7}',
    '{"kind": "dance"}',
    '{"kind": "prove"}',
    '{"kind": "prove", "proof": 7}',
    '{"kind": "act", "id": 1, "mac": 1, "do": "{}"}',
    '{"kind": "act", "id": 1, "mac": "", "do": {"verb": "stop"}}',
    '{"kind": "beat"}',
    '{"kind": "seek", "at_s": 1}',
    '{"kind": "act", "id": 1e999, "mac": "\\ud800", "do": "\\ud800"}',
    "[" * 16000,
    '{"id": ' + "9" * 5000 + "}",
)


@pytest.mark.parametrize("word", WRONG, ids=range(len(WRONG)))
def test_a_word_that_is_none_is_answered_and_nothing_ends(served, word):
    with page(served.host, served.token) as pen:
        pen.socket.send(word)
        assert pen.wait_for("told")["error"]
        pen.socket.send(b"\x00\xff")
        assert pen.wait_for("told")["error"]
        assert pen.prove()
        assert pen.act(verb="stop")["error"] is None


@pytest.mark.parametrize("do", ["[]", "7", '{"verb": ["stop"]}', "{}", '{"verb": "dance"}'])
def test_a_deed_that_is_none_is_answered(served, pen, do):
    pen.say(kind="act", id=1, mac=pen.mac(1, do), do=do)
    assert pen.wait_for("told", id=1)["error"]


def closed(pen: PagePen) -> None:
    """Hear until the server closes."""
    with pytest.raises(ConnectionClosed):
        for _ in iter(lambda: pen.socket.recv(60), None):
            pass


@pytest.mark.slow
def test_a_page_that_says_nothing_but_nonsense_is_cut_off_and_others_are_not(served):
    with page(served.host, served.token) as other:
        with page(served.host) as fool:
            with suppress(ConnectionClosed):  # after a hundred
                for _ in range(110):
                    fool.socket.send("nonsense")
            closed(fool)
        with page(served.host, served.token) as flood:
            flood.prove()
            with suppress(ConnectionClosed):
                for _ in range(20_000):
                    flood.beat()
            closed(flood)
        with page(served.host) as large:
            large.socket.send("x" * (server_module.MESSAGE_BYTES + 1))
            closed(large)
        assert other.prove()
        assert other.wait_for("frame")


def test_no_more_pages_than_the_server_serves(served):
    with pytest.raises(InvalidStatus, match="503"):
        open_pages(served.host, server_module.PAGES + 1)


def open_pages(host: str, left: int) -> None:
    if left:
        with page(host):
            open_pages(host, left - 1)


@pytest.mark.slow
def test_a_page_that_takes_nothing_gets_the_newest_frame_and_no_queue(served):
    served.source.padding = "x" * 600_000
    with page(served.host, max_queue=1) as slow, page(served.host) as quick:
        slow.wait_for("frame")
        for _ in range(40):  # more than sockets hold
            newest = quick.wait_for("frame")
        ticks = [slow.wait_for("frame")["tick"] for _ in range(20)]
        assert max(b - a for a, b in pairwise(ticks)) > 1
        assert ticks[-1] > newest["tick"]


def test_what_can_be_said_otherwise_is_said_again(served):
    with page(served.host) as seen:
        served.source.greeting = {"robot": "other"}
        served.source.version += 1
        again = seen.wait_for("hello")
        assert (again["robot"], again["nonce"]) == ("other", seen.nonce)
        served.source.said.append({"kind": "event", "label": "it fell"})
        assert seen.wait_for("event")["label"] == "it fell"


def test_without_a_token_pages_only_look():
    with Served(StillSource(), None, None) as server:
        assert server.url.endswith("/")
        with page(server.host) as pen:
            assert not pen.hello["writes"]
            assert not pen.prove()
            assert pen.act(verb="stop")["error"]
            found = pen.wait_for("frame")
            assert (found["operator"], found["asked"]) == ("none", {})


def test_a_port_that_is_taken_is_said_to_be():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        source, port = StillSource(), taken.getsockname()[1]

        async def serve() -> None:
            server = PageServer(source, None, None, "127.0.0.1", port)
            await server.run(asyncio.Event(), print)

        with pytest.raises(PortInUseError, match="--port"):
            asyncio.run(serve())


def test_a_number_that_json_does_not_have_is_null_and_the_server_goes_on(served):
    with page(served.host, served.token) as pen:
        served.source.extra = {"com": [0.0, math.nan, -math.inf], "values": {"v": math.inf}}
        while "com" not in (frame := pen.wait_for("frame")):
            pass
        assert frame["com"] == [0.0, None, None]
        assert frame["values"] == {"v": None}
        assert pen.prove()
        assert pen.act(verb="stop")["error"] is None


@pytest.mark.parametrize("part", ["frame", "events", "changeable", "hello"])
def test_whatever_fails_to_be_shown_is_told_once_and_stop_works(served, part, monkeypatch):
    def fails() -> None:
        raise ValueError("a source that is broken")

    with page(served.host, served.token) as pen:
        monkeypatch.setattr(served.source, part, fails)
        served.source.version += 1
        assert "broken" in pen.wait_for("event")["label"]
        assert pen.prove()
        assert pen.act(verb="stop")["error"] is None
        monkeypatch.undo()
        if part == "hello":
            assert pen.wait_for("hello")["robot"] == "still"
        pen.wait_for("frame")
        tick = served.source.tick
        while pen.wait_for("frame")["tick"] < tick + 5:
            pass
        assert not [label for label in pen.events[1:] if "broken" in label]


class BrokenPlayer:
    """A place in a log that cannot be read."""

    def frame(self) -> None:
        raise KeyError("no such chunk")


def test_a_place_of_a_log_that_cannot_be_read_ends_nothing(served, monkeypatch):
    monkeypatch.setattr(served.source, "player", BrokenPlayer)
    with page(served.host) as broken:
        assert "no such chunk" in broken.wait_for("event")["label"]
    monkeypatch.undo()
    with page(served.host) as seen:
        assert seen.wait_for("frame")


def test_whatever_fails_when_it_is_done_is_answered(served, pen, monkeypatch):
    async def fails(*_: object) -> None:
        raise ValueError("an operator that is broken")

    def breaks(*_: object) -> None:
        raise KeyError("no such name")

    with monkeypatch.context() as broken:
        broken.setattr(served.operator, "act", fails)
        assert "broken" in pen.act(verb="acquire")["error"]
        broken.setattr(served.operator, "move", breaks)
        assert "no such name" in pen.act(verb="target")["error"]
    assert pen.act(verb="stop")["error"] is None


@pytest.mark.parametrize("verb", ["recover", "change", "acquire"])
def test_what_was_asked_of_an_old_picture_is_refused(served, pen, verb, monkeypatch):
    monkeypatch.setattr(page_module, "OLD_S", 60.0)
    old = pen.look()
    assert pen.act(verb=verb)["error"] is None
    while pen.wait_for("frame")["tick"] == old:
        pass
    assert pen.act(verb=verb, tick=old)["error"] is None
    monkeypatch.setattr(page_module, "OLD_S", 0.0)  # so long ago was it replaced at least
    for tick in (old, None, -1, "1", [1], 1e99):
        assert pen.act(verb=verb, tick=tick)["error"]
    assert pen.act(verb="stop", tick=old)["error"] is None
    monkeypatch.setattr(page_module, "OLD_S", 60.0)
    assert pen.act(verb=verb)["error"] is None


def test_the_newest_picture_is_not_old_however_long_nothing_comes(served, monkeypatch):
    monkeypatch.setattr(page_module, "OLD_S", 0.0)
    monkeypatch.setattr(served.source, "frame", lambda: None)
    with page(served.host, served.token) as silent:
        assert silent.prove()
        assert silent.act(verb="acquire", tick=None)["error"] is None
        assert silent.act(verb="acquire", tick=3)["error"]
        sent = iter([{"kind": "frame", "tick": 7}])
        monkeypatch.setattr(served.source, "frame", lambda: next(sent, None))
        silent.wait_for("frame")
        assert silent.act(verb="acquire", tick=7)["error"] is None
        assert silent.act(verb="acquire", tick=None)["error"]


def test_stops_wait_for_nothing_else_that_a_page_asked_for(served, pen, monkeypatch):
    """Also not for as many things as may be asked for at once, and not for the page to stay."""
    let, loop = threading.Event(), served.loop
    plain = served.operator.act

    async def slow(page: object, do: dict[str, object]) -> dict[str, object]:
        await loop.run_in_executor(None, let.wait, 60)
        return await plain(page, do)

    monkeypatch.setattr(served.operator, "act", slow)
    for _ in range(page_module.MOST_AT_ONCE):
        pen.send(verb="recover")
    assert pen.act(verb="recover")["error"]
    pen.send(verb="stop")
    assert pen.act(verb="dance")["error"]  # so the stop was heard
    pen.socket.close()
    assert served.operator.gone.wait(30)
    let.set()
    deadline = time.monotonic() + 30
    while not served.operator.done and time.monotonic() < deadline:
        time.sleep(0.01)
    assert served.operator.done == [{"verb": "stop"}]


def test_a_greeting_is_made_once_however_many_ask(served):
    for _ in range(5):
        with page(served.host, served.token) as pen:
            assert pen.hello["robot"] == "still"
            assert len(pen.hello["nonce"]) == 32
    assert served.source.greeted == 1
    served.source.version += 1
    served.source.greeting = {"robot": "other"}
    with page(served.host) as pen:
        assert pen.hello["robot"] == "other"
    assert served.source.greeted == 2


def test_who_opens_pages_all_the_time_is_refused(served, monkeypatch):
    monkeypatch.setattr(server_module, "NEW_A_SECOND", 1)
    with pytest.raises(InvalidStatus, match="429"):
        open_pages(served.host, 12)
    while True:
        with suppress(InvalidStatus), page(served.host) as pen:
            assert pen.wait_for("frame")
            return


@pytest.mark.slow
def test_a_page_that_draws_slowly_is_sent_the_newest_frame_when_it_has_drawn(served):
    with page(served.host) as pen:
        for drawn in (0, 2, 5):
            pen.say(kind="drawn", frames=drawn)
        first = pen.wait_for("frame")["tick"]
        for _ in range(40):
            served.source.said.append({"kind": "event", "label": "a frame's time is gone"})
            pen.wait_for("event")
        pen.look()
        waits = sum(word["kind"] == "frame" for word in pen._waits)
        assert waits <= 5 + AHEAD - 1
        before = pen.tick
        pen.say(kind="drawn", frames=5 + AHEAD)
        pen._waits.clear()
        assert pen.wait_for("frame")["tick"] > before + 20 > first


def test_bad_connections_are_one_line_and_no_traceback(capsys):
    with Served(StillSource(), NotingOperator(), new_token()) as served:
        address, _, port = served.host.rpartition(":")
        for sent in (b"GET / HTTP/1.0\r\n\r\n", b"garbage\r\n\r\n", b"A" * 70_000) * 5:
            with socket.create_connection((address, int(port)), 30) as client, suppress(OSError):
                client.sendall(sent)
                while client.recv(4096):
                    continue  # until the server has closed it
        assert get(served.host, "/").status == 200
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert told.count("\n") == 1
    assert "bad connections" in told
