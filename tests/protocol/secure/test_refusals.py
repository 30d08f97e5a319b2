"""Why a connection is refused: told by a handshake of our own."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest
from support.certificates.laboratory import DAY, laboratory

from hoap3.protocol.secure.credentials import Credentials, read_credentials
from hoap3.protocol.secure.refusals import why_refused
from hoap3.tools.services.certificates import init, issue


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    folder = laboratory(tmp_path_factory.mktemp("lab") / "certs")
    issue(folder, "old", "observer", [], timedelta(seconds=-1))
    other = folder / "other"
    init(other, DAY)
    issue(other, "eve", "operator", [], DAY)
    return folder


@contextmanager
def served(folder: Path | None, ca: Path | None = None) -> Iterator[str]:
    """An endpoint where one connection is taken, with TLS or, without a folder, in plain."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def take() -> None:
            plain = server.accept()[0]
            with plain:
                if folder is None:
                    plain.recv(64)
                    return
                context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
                context.load_cert_chain(folder / "cert.pem", folder / "key.pem")
                context.load_verify_locations(ca or folder / "ca.pem")
                context.verify_mode = ssl.CERT_REQUIRED
                try:
                    with context.wrap_socket(plain, server_side=True) as secured:
                        secured.recv(1)
                except OSError:
                    pass  # as was to be shown

        thread = threading.Thread(target=take)
        thread.start()
        yield f"tls/127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def ours(folder: Path) -> Credentials:
    return read_credentials(folder)


def test_nobody_there(certs):
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tls/127.0.0.1:{server.getsockname()[1]}"
    assert "nobody listens" in why_refused(endpoint, ours(certs / "anna"))


@pytest.mark.parametrize(
    ("server", "robot", "words"),
    [
        (None, "arm", "does not speak TLS"),
        ("qp", "arm", "certificate is not what it should be"),  # a client's, which serves nothing
        ("old", "arm", "certificate is not what it should be"),
        ("other/eve", "arm", "certificate is not what it should be"),
        ("arm", "leg", "not of robot 'leg'"),
        ("arm", "arm", "TLS is set up"),
    ],
)
def test_what_is_wrong_with_the_other_side_is_said(server, robot, words, certs):
    with served(None if server is None else certs / server, certs / "ca.pem") as endpoint:
        assert words in why_refused(endpoint, ours(certs / "anna"), robot)


def test_another_authority_of_ours_is_said(certs):
    with served(certs / "arm", certs / "other" / "ca.pem") as endpoint:
        assert "another authority" in why_refused(endpoint, ours(certs / "anna"), "arm")
