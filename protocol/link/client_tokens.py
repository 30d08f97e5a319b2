"""What a robot makes of its clients' liveliness tokens: pure bookkeeping, no network.

Tokens come and go as samples, some of which may be lost. A look-up makes up for that; it takes
time, and samples that are newer than its begin count for more than what it found.
`python -m tests.proofs authority` runs this code against every order of samples and look-ups.
"""

from __future__ import annotations

MAX_CLIENTS = 1024  # whose tokens a robot remembers; the oldest are forgotten first


class ClientTokens:
    """The clients whose tokens are seen.

    Attributes:
        seen: clients, and after how many samples they were seen; the oldest first.
        asked: clients that asked for authority, likewise.
        taken: how many samples were taken.
        deleted: which of them was the last that told of an end.
    """

    def __init__(self) -> None:
        self.seen: dict[str, int] = {}
        self.asked: dict[str, int] = {}
        self.taken = self.deleted = 0

    def asks(self, who: str) -> bool:
        """Note that a client asks for authority; whether its token is seen."""
        _remember(self.asked, who, self.taken)
        return who in self.seen

    def take(self, who: str, *, came: bool) -> bool:
        """Take a sample: a token came or went; whether a client that asked has vanished by it."""
        self.taken += 1
        if came:
            _remember(self.seen, who, self.taken)
            return False
        self.deleted = self.taken
        self.seen.pop(who, None)
        return self.asked.pop(who, None) is not None

    def found(self, who: str, *, alive: bool, taken: int) -> bool:
        """Take what a look-up found, begun after `taken` samples; whether `who` has vanished."""
        if alive:
            if self.deleted <= taken:
                _remember(self.seen, who, self.taken)
            return False
        if self.seen.get(who, 0) > taken:
            return False
        self.seen.pop(who, None)
        return True


def _remember(clients: dict[str, int], who: str, taken: int) -> None:
    clients[who] = taken
    if len(clients) > MAX_CLIENTS:
        del clients[next(iter(clients))]
