"""What `hoap3 verify` finds of the logs that a report is about."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import LogError
from hoap3.tools.html.numbers import count, number
from hoap3.tools.verify.verify import Verification, verify


@dataclass(frozen=True)
class Checked:
    """The result.

    Attributes:
        found: what was recomputed, or None.
        why: why nothing was, "" where something was.
    """

    found: Verification | None
    why: str = ""

    @property
    def verdict(self) -> str:
        """`true`, `false` or `not verified`."""
        return self.found.verdict if self.found is not None else "not verified"

    @property
    def gaps(self) -> list[str]:
        """What the head of the page has to say of it."""
        if self.found is None or not self.found.claims.false:
            return []
        claims = self.found.claims
        first = claims.by_tick()[0]
        wrong = f"{count(claims.false)} of {count(claims.checked)} numbers that were recomputed"
        where = f"the first is {first.claim} at tick {first.tick}"
        return [f"{wrong} are not what the logs claim; {where}."]

    @property
    def rows(self) -> list[list[object]]:
        """Claim, how often it was recomputed, is false and could not be; first tick; worst."""
        if self.found is None:
            return []
        return [
            [
                name,
                count(each.checked),
                count(each.false),
                "–" if each.first_false is None else each.first_false,
                number(each.largest),
                ", ".join(f"{reason} ({count(n)})" for reason, n in each.unverified.items()) or "–",
            ]
            for name, each in sorted(self.found.claims.counts.items())
        ]

    def as_json(self) -> dict[str, Any]:
        """The counts, as `--json` prints them."""
        if self.found is None:
            return {"verdict": self.verdict, "why": self.why}
        claims = self.found.claims
        counts = {"checked": claims.checked, "false": claims.false}
        return {"verdict": self.verdict, **counts, "unverified": claims.unverifiable}


def check(path: Path) -> Checked:
    """Verify the folder of a run, or one `*.mcap`; a log that cannot be, says why."""
    try:
        return Checked(verify(path))
    except LogError as error:
        return Checked(None, str(error))
