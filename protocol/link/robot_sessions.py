"""Sessions of robots on a network: each holds a liveliness token that identifies it.

The name of a robot is unique per network. Tokens show where two robots use one name.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Self
from urllib.parse import quote, unquote

LONGEST_TOKEN = 1024  # characters; longer ones are ignored


class RobotSession(NamedTuple):
    """One session of a robot. Of two with one name, the smaller one is the incumbent.

    Attributes:
        started: wall-clock time of its start [ns].
        session_id: of its messages.
        pid, host: of its process.
        endpoint: where it listens, or to which router it connects.
    """

    started: int
    session_id: int
    pid: int
    host: str
    endpoint: str

    @property
    def leaf(self) -> str:
        """Last chunk of the key of its token."""
        return ",".join(quote(str(value), safe="") for value in self)

    @classmethod
    def read(cls, token: Any) -> Self | None:
        """Session of a token `robots/<name>/session/<leaf>`; None if it is malformed."""
        text = str(token)
        words = [unquote(word) for word in text.rsplit("/", 1)[-1].split(",")]
        if len(text) > LONGEST_TOKEN or len(words) != len(cls._fields):
            return None
        try:
            return cls(int(words[0]), int(words[1]), int(words[2]), words[3], words[4])
        except ValueError:
            return None

    def __str__(self) -> str:
        where = self.endpoint or "no endpoint"
        return f"{where} (process {self.pid} on {self.host}, session {self.session_id})"


def name_conflict(robot: str, sessions: list[RobotSession]) -> str:
    """Error text for several robots that use one name."""
    listed = "; ".join(map(str, sorted(sessions)))
    return (
        f"{len(sessions)} robots on this network are called {robot!r}: {listed}. Stop all but one "
        "(`hoap3 stop` reaches all of them), or start it under another name: --set name=NAME"
    )
