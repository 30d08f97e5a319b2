"""Who may look, and whose words count."""

from __future__ import annotations

import hashlib
import hmac
import socket

import pytest

from hoap3.tools.view.access import Gate, Visit, new_token

ORIGIN = "http://127.0.0.1:8080"


def code(token: str, text: str) -> str:
    return hmac.new(token.encode(), text.encode(), hashlib.sha256).hexdigest()


class Pen:
    """Writes as a page does that knows the token."""

    def __init__(self, token: str, visit: Visit) -> None:
        self.token, self.visit = token, visit

    def prove(self, origin: str = ORIGIN) -> bool:
        return self.visit.prove(code(self.token, self.visit.nonce + origin))

    def mac(self, number: object, text: str) -> str:
        return code(self.token, f"{self.visit.nonce}\n{number}\n{text}")


@pytest.fixture
def pen() -> Pen:
    token = new_token()
    return Pen(token, Gate(token, "127.0.0.1", 8080).visit(ORIGIN))


def test_tokens_are_long_and_each_another():
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 32


LOCAL = "127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"
EVIL = "evil.example:8080", "localhost.evil.example:8080", "192.168.0.7.evil.example:8080"
NONE = "", ":8080", None, "127.0.0.1:8080@evil.example", "127.0.0.1:8080, evil.example"
OTHERS = "192.168.0.7:8080", "[fe80::1]:8080", f"{socket.gethostname()}:8080"


@pytest.mark.parametrize(
    ("address", "host", "known"),
    [
        *(("127.0.0.1", host, True) for host in LOCAL),
        *(("127.0.0.1", host, False) for host in (*EVIL, *NONE, OTHERS[0])),
        *(("127.0.0.1", host, False) for host in ("127.0.0.1:8081", "127.0.0.1")),
        *(("0.0.0.0", host, True) for host in (*OTHERS, "localhost:8080")),
        *(("0.0.0.0", host, False) for host in EVIL),
    ],
)
def test_known_are_names_of_loopback_and_elsewhere_addresses_and_its_own_name(address, host, known):
    assert Gate("t", address, 8080).knows_host(host) is known


def test_the_standard_port_stands_in_no_host():
    assert Gate("t", "127.0.0.1", 80).knows_host("127.0.0.1")


STRANGE = None, "null", "http://evil.example", "https://127.0.0.1:8080"
NEARLY = "http://127.0.0.1:8081", "http://localhost:8080", "http://127.0.0.1:8080/"


@pytest.mark.parametrize("origin", [*STRANGE, *NEARLY])
def test_a_page_from_elsewhere_is_none_of_ours(origin):
    gate = Gate("t", "127.0.0.1", 8080)
    assert gate.knows_origin(ORIGIN, "127.0.0.1:8080")
    assert not gate.knows_origin(origin, "127.0.0.1:8080")


def test_an_origin_is_of_no_use_to_a_strange_host():
    gate = Gate("t", "127.0.0.1", 8080)
    assert not gate.knows_origin("http://evil.example:8080", "evil.example:8080")


def test_words_with_their_codes_and_rising_numbers_are_taken(pen):
    assert pen.prove()
    for number in (1, 2, 7, 2**40):
        assert pen.visit.accept(number, "stop", pen.mac(number, "stop")) == ""


def test_nothing_is_taken_before_the_proof(pen):
    assert pen.visit.accept(1, "stop", pen.mac(1, "stop"))
    assert not pen.visit.prove("")
    assert not pen.visit.prove(code("guess", pen.visit.nonce + ORIGIN))
    assert not pen.prove(origin="http://evil.example")
    assert pen.visit.accept(1, "stop", pen.mac(1, "stop"))
    assert not pen.visit.proved


def test_a_proof_that_was_recorded_proves_nothing_to_another_connection(pen):
    gate = Gate(pen.token, "127.0.0.1", 8080)
    again = gate.visit(ORIGIN)
    assert not again.prove(code(pen.token, pen.visit.nonce + ORIGIN))
    assert Pen(pen.token, again).prove()
    assert again.accept(1, "stop", pen.mac(1, "stop"))


def test_a_word_counts_once(pen):
    pen.prove()
    assert pen.visit.accept(5, "stop", pen.mac(5, "stop")) == ""
    for number in (5, 4, 1):
        assert pen.visit.accept(number, "stop", pen.mac(number, "stop"))
    assert pen.visit.accept(6, "stop", pen.mac(6, "stop")) == ""


def test_a_code_is_of_one_text_and_one_number(pen):
    pen.prove()
    assert pen.visit.accept(1, "recover", pen.mac(1, "stop"))
    assert pen.visit.accept(2, "stop", pen.mac(1, "stop"))
    assert pen.visit.accept(1, "stop", "")
    assert pen.visit.accept(1, "stop", "é" * 64)
    assert pen.visit.accept(1, "stop", pen.mac(1, "stop")) == ""


@pytest.mark.parametrize("number", [0, -1, 2**53, True, 1.0, "1", None])
def test_numbers_that_are_none_are_refused(pen, number):
    pen.prove()
    assert pen.visit.accept(number, "stop", pen.mac(number, "stop"))


def test_without_a_token_nobody_writes():
    visit = Gate(None, "127.0.0.1", 8080).visit(ORIGIN)
    assert not visit.prove(code("", visit.nonce + ORIGIN))
    assert visit.accept(1, "stop", code("", f"{visit.nonce}\n1\nstop"))
