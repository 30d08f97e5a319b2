"""Who may look, and who may move the robot: Host, Origin, token.

Anybody's web page can be open in the browser that shows ours, and can try to reach our port. So the
name under which we are reached and the page that asks are checked, and each write carries a code
that only who knows the token can make, for one connection and one number alone.

The token is on the command line and in the part of the address behind `#`, which browsers do not
send. Nothing is encrypted: off loopback, whoever reads the traffic sees what is shown, but cannot
make codes of his own. Whoever can alter the traffic can: he alters the page itself, which then
gives him the token. No code helps against him; a tunnel does, such as ssh's.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
import socket

from hoap3.protocol.config.endpoints import is_loopback

TOKEN_BYTES = 24
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")
WEB_PORT = 80  # which stands in no Host


def new_token() -> str:
    """192 random bits, as text that can stand in an address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Gate:
    """Checks of one server.

    Args:
        token: see `new_token`; None where nobody may write.
        host, port: where it listens.
    """

    def __init__(self, token: str | None, host: str, port: int) -> None:
        self._token = None if token is None else token.encode()
        self._host, self._port = host, port
        self._loopback = is_loopback(host)

    @property
    def writes(self) -> bool:
        """Whether anybody may write."""
        return self._token is not None

    def knows_host(self, host: str | None) -> bool:
        """Whether a request's Host is a name of ours: a name of somebody's DNS is not.

        On loopback those are the names of loopback; else also addresses, and this machine's name.
        """
        if host is None:
            return False
        name, colon, port = host.rpartition(":") if not host.endswith("]") else (host, "", "")
        if not colon:
            name, port = host, str(WEB_PORT)
        if not port.isdecimal() or port != str(self._port):
            return False
        name = name.lower()
        if name in LOOPBACK_NAMES or name == self._host.lower():
            return True
        if self._loopback:
            return False
        return _is_address(name) or name == socket.gethostname().lower()

    def knows_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether the page that asks came from us: its origin is the Host that it asks."""
        return self.knows_host(host) and origin is not None and origin == f"http://{host}"

    def visit(self, origin: str) -> Visit:
        """One connection."""
        return Visit(self._token, origin)


class Visit:
    """What one connection has proved; its nonce is of no use to any other.

    Args:
        token: the server's, or None where nobody may write.
        origin: of the page.

    Attributes:
        nonce: to be proved with, hexadecimal.
        proved: whether the page knows the token.
    """

    def __init__(self, token: bytes | None, origin: str) -> None:
        self._token, self._origin = token, origin
        self.nonce = secrets.token_hex(16)
        self.proved = False
        self._newest = 0

    def prove(self, proof: str) -> bool:
        """Take the proof of the token; whether it is one."""
        self.proved = self._is(proof, self.nonce + self._origin)
        return self.proved

    def accept(self, number: object, text: str, code: str) -> str:
        """Take a numbered word of the page; "" or why it is refused.

        Args:
            number: must be above that of each one before.
            text: what was said, as it was sent.
            code: of nonce, number and text.
        """
        if self._token is None:
            return "nobody may write here: it was started with --no-steering"
        if not self.proved:
            return "the token was not proved: open the whole address that `hoap3 view` printed"
        if not isinstance(number, int) or isinstance(number, bool) or not 0 < number < 2**53:
            return "no number"
        if not self._is(code, f"{self.nonce}\n{number}\n{text}"):
            return "the code is not that of this text"
        if number <= self._newest:
            return "its number is not above the last one"
        self._newest = number
        return ""

    def _is(self, code: str, text: str) -> bool:
        if self._token is None:
            return False
        expected = hmac.new(self._token, text.encode("utf-8", "surrogatepass"), hashlib.sha256)
        return hmac.compare_digest(expected.hexdigest().encode(), code.encode("utf-8", "replace"))


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True
