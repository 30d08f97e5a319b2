"""Links that close at once.

Zenoh gives each TCP socket an SO_LINGER of ten seconds. A peer that froze leaves bytes unsent,
so the close blocks one of Zenoh's threads for as long, and with it whatever that thread holds:
seen as a robot that nobody reached, not even to stop it. Without lingering the kernel still
delivers what it can, and close returns.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

_LINGER = struct.Struct("ii")
_SOCKETS = Path("/proc/self/fd")


def forbid_lingering() -> int:
    """Take SO_LINGER off every TCP socket of this process that has it; how many there were."""
    changed = 0
    for one in _tcp_sockets():
        with one:
            lingers, _ = _LINGER.unpack(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
            if lingers:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER.pack(0, 0))
                changed += 1
    return changed


def shut_down(peer: str) -> int:
    """End this process's TCP connections with a peer, so that Zenoh closes what runs over them.

    Args:
        peer: Zenoh's locator of it, such as `tls/127.0.0.1:41234`.

    Returns:
        How many there were.
    """
    host, _, port = peer.partition("/")[2].partition("?")[0].rpartition(":")
    wanted, ended = (_plain(host.strip("[]")), port), 0
    for one in _tcp_sockets():
        with one:
            try:
                address = one.getpeername()
            except OSError:
                continue  # it listens
            if (_plain(address[0]), str(address[1])) == wanted:
                with contextlib.suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)
                ended += 1
    return ended


def _plain(host: str) -> str:
    """An address without its zone; of IPv4 as such, also where a socket of IPv6 took it."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host  # a name
    return str(getattr(address, "ipv4_mapped", None) or address)


def _tcp_sockets() -> Iterator[socket.socket]:
    """A copy of each TCP socket of this process; the caller closes it."""
    for name in os.listdir(_SOCKETS) if _SOCKETS.is_dir() else ():
        try:
            if not os.readlink(_SOCKETS / name).startswith("socket:"):
                continue
            one = socket.socket(fileno=os.dup(int(name)))
        except OSError:
            continue  # closed meanwhile
        if one.type != socket.SOCK_STREAM or one.family == socket.AF_UNIX:
            one.close()
            continue
        yield one
