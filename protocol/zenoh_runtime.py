"""How many threads Zenoh works with: to be chosen before it is imported, since it asks but once."""

from __future__ import annotations

import os

ROBOT_WORKERS = 2
"""Zenoh closes the link of a peer that froze with SO_LINGER, which blocks a worker for 10 s. With
one worker the robot could be reached by nobody meanwhile, its controller included."""


def choose_workers(workers: int) -> None:
    """One pool for everything costs least, and fewer threads cost less; the environment decides."""
    shared = "".join(f"{part}:(handover:app)," for part in ("rx", "tx", "acc", "net"))
    os.environ.setdefault("ZENOH_RUNTIME", f"({shared}app:(worker_threads:{workers}))")
