"""Why an endpoint refuses us: one TLS handshake of our own, for Zenoh says only that it failed."""

from __future__ import annotations

import contextlib
import re
import socket
import ssl
from typing import Any

from hoap3.protocol.secure.credentials import Credentials

TIMEOUT_S = 2.0
ALERT_S = 0.5  # in which a server says that it does not like our certificate
_PLACE = re.compile(r"[a-z]+/(?P<host>\[[^\]]+\]|[^:/?#]+):(?P<port>\d+)")
_ALERTS = {
    "CERTIFICATE_EXPIRED": "our certificate has expired",
    "UNKNOWN_CA": "it trusts another authority than the one that issued our certificate",
    "CERTIFICATE_UNKNOWN": "it does not accept our certificate",
    "BAD_CERTIFICATE": "it does not accept our certificate",
    "CERTIFICATE_REQUIRED": "it wants a certificate",
}


def why_refused(endpoint: str, credentials: Credentials, robot: str = "") -> str:
    """What a handshake with an endpoint tells, in words; at most some seconds.

    Args:
        endpoint: `tls/host:port`.
        credentials: ours.
        robot: whom we expect there, "" for any.
    """
    place = _PLACE.match(endpoint)
    if place is None:
        return "it has no host and port"
    host, port = place["host"].strip("[]"), int(place["port"])
    context = ssl.create_default_context(cafile=str(credentials.ca))
    context.load_cert_chain(credentials.certificate, credentials.key)
    try:
        with socket.create_connection((host, port), TIMEOUT_S) as plain:
            return _of_handshake(context, plain, host, robot)
    except ConnectionRefusedError:
        return "nobody listens there"
    except OSError as error:
        return f"it cannot be reached: {error.strerror or error}"


def listens(endpoint: str) -> bool:
    """Whether anybody takes a TCP connection at an endpoint."""
    place = _PLACE.match(endpoint)
    if place is None:
        return False
    try:
        address = place["host"].strip("[]"), int(place["port"])
        with socket.create_connection(address, TIMEOUT_S):
            return True
    except OSError:
        return False


def _of_handshake(context: ssl.SSLContext, plain: socket.socket, host: str, robot: str) -> str:
    try:
        with context.wrap_socket(plain, server_hostname=host) as secured:
            theirs: Any = secured.getpeercert()
            subject = dict(pair for part in theirs["subject"] for pair in part)
            secured.settimeout(ALERT_S)
            with contextlib.suppress(TimeoutError):  # it is content with us
                secured.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not what it should be: {error.verify_message}"
    except TimeoutError:
        return "it does not speak TLS: does it run without the secure profile?"
    except ssl.SSLError as error:
        for alert, words in _ALERTS.items():
            if alert in (error.reason or ""):
                return words
        return f"it does not speak TLS as we do ({error.reason or error})"
    except OSError:
        return "it does not speak TLS: does it run without the secure profile?"
    name = str(subject.get("commonName", ""))
    if robot and name != robot:
        return f"its certificate is that of {name!r}, not of robot {robot!r}"
    return "TLS is set up, but nothing answers in time"
