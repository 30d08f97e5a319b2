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
    def outcomes(self) -> dict[int, dict[str, Any]]:
        """What the answers came to, by session of the robot, as a replay computes it."""
        return self.found.outcomes if self.found is not None else {}

    @property
    def unjudged(self) -> list[str]:
        """Parts of the log that verdicts rest on and that could not be verified, with reasons."""
        if self.found is None:
            return [f"claims: {self.why}"]
        return [
            f"{name}: {reason}"
            for name, each in sorted(self.found.claims.counts.items())
            for reason in each.unverified
            if name.startswith(RESTS_ON)
        ]

    @property
    def false(self) -> list[str]:
        """Claims that do not hold."""
        counts = self.found.claims.counts if self.found is not None else {}
        return sorted(name for name, each in counts.items() if each.false)

    @property
    def gaps(self) -> list[str]:
        """What the head of the page has to state of it."""
        unjudged = [f"Not verified: {each}." for each in self.unjudged]
        if self.found is None or not self.found.claims.false:
            return unjudged
        claims = self.found.claims
        first = claims.by_tick()[0]
        wrong = f"{count(claims.false)} of {count(claims.checked)} numbers that were recomputed"
        where = f"the first is {first.claim} at tick {first.tick}"
        return [f"{wrong} are not what the logs claim; {where}.", *unjudged]

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
            return {"verdict": self.verdict, "why": self.why, "unjudged": self.unjudged}
        claims = self.found.claims
        counts = {"checked": claims.checked, "false": claims.false}
        counts |= {"unverified": claims.unverifiable}
        return {
            "verdict": self.verdict,
            **counts,
            "false_claims": self.false,
            "unjudged": self.unjudged,
        }


RESTS_ON = ("summary", "session", "event", "reset", "description", "config", "log of")
"""How claims begin whose parts of a log verdicts rest on."""


def check(path: Path, *, allow_code: bool = False) -> Checked:
    """Verify the folder of a run, or one `*.mcap`, with the controller repeated.

    Args:
        path: of the log; one that cannot be verified says why.
        allow_code: import what the log names by a dotted path.
    """
    try:
        return Checked(verify(path, repeat=True, allow_code=allow_code))
    except LogError as error:
        return Checked(None, str(error))
