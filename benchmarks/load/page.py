"""The live page of a running robot, in processes of its own: its server, and who looks at it."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Origin

from hoap3.tools.machine.processes import Child, Lifeline, read_order

PATIENCE_S = 60.0  # for a robot that starts
LOOK_S = 0.05
END_S = 10.0
COMMAND = "hoap3.tools.cli.app"
BROWSER = (
    "--headless=new",
    "--no-sandbox",  # as root, as which real-time rights are had most often
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",  # else a browser without a window ends at once
)


def served(lifeline: Lifeline, robot: str, endpoint: str) -> tuple[Child, str]:
    """A server of the page, as soon as the robot answers; and the page's address.

    Raises:
        TimeoutError: there is no robot.
    """
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and not lifeline.cut():
        order = [COMMAND, "view", robot, "--connect", endpoint, "--port", "0"]
        server = Child(order, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        line = b"" if server.stdout is None else server.stdout.readline()
        if line.startswith(b"http"):
            return server, line.decode().strip()
        server.end(END_S)
        time.sleep(LOOK_S)
    raise TimeoutError(f"no page of robot {robot!r} within {PATIENCE_S:g} s")


def take(socket: Connection, lifeline: Lifeline) -> dict[str, int]:
    """Take what the page is sent, and draw nothing, until the end."""
    frames = taken = 0
    while not lifeline.cut():
        try:
            word = socket.recv(timeout=LOOK_S)
        except TimeoutError:
            continue
        except ConnectionClosed:
            break
        taken += len(word)
        frames += '"kind":"frame"' in str(word[:64])
    return {"frames": frames, "bytes": taken}


def look(order: dict[str, Any], lifeline: Lifeline) -> dict[str, Any]:
    """Look at the page, with a browser or with a client that draws nothing."""
    figures: dict[str, Any] = {"failed": []}
    server = None
    try:
        server, address = served(lifeline, order["robot"], order["endpoint"])
        if order["browser"] is None:
            page = f"ws://{urlsplit(address).netloc}/socket"
            with connect(page, origin=Origin(address.partition("/#")[0])) as socket:
                figures |= take(socket, lifeline)
        else:
            with tempfile.TemporaryDirectory() as profile:
                words = [order["browser"], *BROWSER, f"--user-data-dir={profile}", address]
                silent = subprocess.DEVNULL
                with subprocess.Popen(words, stdout=silent, stderr=silent) as browser:
                    lifeline.cut(None)
                    if browser.poll() is not None:
                        figures["failed"].append(f"{order['browser']} ended by itself")
                    browser.terminate()
    except (OSError, InvalidHandshake) as error:
        figures["failed"].append(str(error))
    finally:
        if server is not None:
            server.end(END_S)
    return figures


def main() -> int:
    """Look until the lifeline is cut; what was seen goes to standard output as JSON."""
    lifeline, order = Lifeline(), read_order()
    print("ready", flush=True)
    json.dump(look(order, lifeline), sys.stdout)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
