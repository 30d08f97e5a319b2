"""The same as hoap3_client.c, for machines without a compiler."""

from __future__ import annotations

import socket
import struct
import sys
import time


def connected(port: int) -> socket.socket:
    end = time.monotonic() + 10.0
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def whole(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        more = connection.recv(size - len(data))
        if not more:
            raise ConnectionError("the robot has gone")
        data += more
    return data


def main(first_port: str, port: str, order: str, slots: str, check: str) -> None:
    frame, legacy = struct.Struct(f"<{slots}d"), order == "legacy"
    exchanges = int(float(check) * 1000 / 2)
    with connected(int(first_port)) as first:
        first.sendall(struct.pack("<2d", 2, float(check)))
        connection = connected(int(port))
    counts = command = [0.0] * int(slots)
    for _ in range(exchanges):
        if legacy:
            connection.sendall(frame.pack(*command))
        counts = frame.unpack(whole(connection, frame.size))
        command = [counts[0] + 10, *counts[1:]]
        if not legacy:
            connection.sendall(frame.pack(*command))
    connection.close()
    print(exchanges, int(counts[0]))


main(*sys.argv[1:])
