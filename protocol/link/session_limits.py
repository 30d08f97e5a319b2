"""What one Zenoh session takes from the network at most: sizes, connections, open files.

Without certificates these limits cannot keep a stranger out. They bound the memory that he can
fill, and keep the robot and its holder connected meanwhile.
"""

from __future__ import annotations

import resource

MAX_MESSAGE_BYTES = 2 << 20
"""Of anything that is received; a description, which is an answer, has 1 MiB at most."""

MAX_REQUEST_BYTES = 64 << 10
"""Of a sample or a query that is received; larger ones are dropped, a query without an answer."""

MAX_CONFIG_BYTES = 16 << 10  # that one side tells the other, for its log

ACCEPT_TIMEOUT_MS = 3000
"""A connection that has not completed Zenoh's handshake by then is closed."""

MAX_PENDING = 2048  # connections that have not completed it; further ones are closed at once
MAX_SESSIONS = 1000  # that have completed it
OWN_FILES = 128  # that the process needs besides
WANTED_FILES = 4096


SIZE_FILTER = {
    "flows": ["ingress"],
    "messages": ["put", "delete", "query"],
    "key_exprs": ["**"],
    "size_limit": MAX_REQUEST_BYTES,
}
"""An entry of Zenoh's `low_pass_filter`."""


def accept_limits() -> dict[str, int]:
    """Zenoh's `transport/unicast`, for the open files that this process may have."""
    pending, sessions = connection_limits(raise_file_limit())
    return {
        "accept_timeout": ACCEPT_TIMEOUT_MS,
        "accept_pending": pending,
        "max_sessions": sessions,
        "max_links": 1,
    }


def connection_limits(files: int) -> tuple[int, int]:
    """Pending connections and sessions that fit in a number of open files, at least 8 each."""
    room = max(16, files - OWN_FILES)
    sessions = min(MAX_SESSIONS, room // 2)
    return min(MAX_PENDING, room - sessions), sessions


def raise_file_limit() -> int:
    """Raise this process's soft limit of open files as far as is useful and allowed.

    Returns:
        The limit that is in force.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    return WANTED_FILES if soft == resource.RLIM_INFINITY else soft
