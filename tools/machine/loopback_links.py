"""The links that `hoap3 latency` can measure: how both sides reach each other on this machine.

Everything stays on loopback, on a port or a path that nobody uses. TLS gets a certificate that is
made for this measurement and thrown away with it; a router is a process between both sides, as
privileged and placed as they are.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import LinkSettings, RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.runtime.realtime import prepare_process
from hoap3.tools.machine.processes import die_with_parent, read_order, start_module

LINKS = ("tcp", "udp", "tls", "unixsock", "router")
LinkPair = tuple[dict[str, Any], dict[str, Any]]
"""Changes of `link` in the settings of a robot and of its controller."""

_READY = b"ready\n"


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of this machine that was free a moment ago."""
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def link(name: str, realtime: RealtimeSettings) -> Iterator[LinkPair]:
    """Settings for both sides; what the link needs exists until this ends.

    Args:
        name: one of `LINKS`.
        realtime: of the router.

    Raises:
        UsageError: no such link, or a program that it needs is missing.
    """
    if name not in LINKS:
        raise UsageError(f"--link: no link is called {name!r}. Choose one of {', '.join(LINKS)}")
    with tempfile.TemporaryDirectory(prefix="hoap3-") as folder:
        if name == "router":
            endpoint = f"tcp/127.0.0.1:{free_port()}"
            with _router(endpoint, realtime):
                client = {"mode": "client", "listen": (), "connect": (endpoint,)}
                yield client, client
            return
        yield _direct(name, Path(folder))


def _direct(name: str, folder: Path) -> LinkPair:
    listen = connect = f"tcp/127.0.0.1:{free_port()}"
    if name == "udp":
        listen = connect = f"udp/127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    elif name == "unixsock":
        listen = connect = f"unixsock-stream/{folder / 'link'}"
    elif name == "tls":
        key, certificate = self_signed(folder)
        place = f"tls/127.0.0.1:{free_port()}"
        listen = f"{place}#listen_private_key_file={key};listen_certificate_file={certificate}"
        connect = f"{place}#root_ca_certificate_file={certificate}"
    return {"listen": (listen,)}, {"connect": (connect,)}


def self_signed(folder: Path) -> tuple[Path, Path]:
    """Key and certificate of loopback (EC P-256), for a day, in a folder.

    Raises:
        UsageError: openssl is missing.
        Hoap3Error: it failed.
    """
    program = shutil.which("openssl")
    if program is None:
        raise UsageError("--link tls: openssl is missing. Install it, or choose another link")
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    made = subprocess.run(
        [
            program, "req", "-x509", "-nodes", "-days", "1", "-subj", "/CN=localhost",
            "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
            "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
            "-addext", "basicConstraints=critical,CA:FALSE",
            "-keyout", str(key), "-out", str(certificate),
        ],
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    if made.returncode:
        raise Hoap3Error(f"openssl made no certificate: {made.stderr.strip()[-200:]}")
    return key, certificate


@contextmanager
def _router(endpoint: str, realtime: RealtimeSettings) -> Iterator[None]:
    order = {"endpoint": endpoint, "realtime": realtime.model_dump(mode="json")}
    child = start_module("hoap3.tools.machine.loopback_links", order, [])
    try:
        if child.stdout is None:
            raise Hoap3Error("the router has no standard output")
        if child.stdout.readline() != _READY:
            raise Hoap3Error("the router did not start")
        yield
    finally:
        child.kill()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()


def main() -> None:
    """Be a router until killed; the order comes on standard input."""
    die_with_parent()
    order = read_order()
    prepare_process(RealtimeSettings(**order["realtime"]))
    from hoap3.protocol.link.zenoh_link import open_session

    role: dict[str, Any] = {"mode": "router", "listen": (order["endpoint"],)}
    settings = LinkSettings().model_copy(update=role)  # no config of a service may say "router"
    with open_session(settings):
        sys.stdout.buffer.write(_READY)
        sys.stdout.flush()
        while True:
            time.sleep(3600)


if __name__ == "__main__":
    main()
