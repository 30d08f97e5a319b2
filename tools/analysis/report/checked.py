"""What `hoap3 verify` finds of the logs that a report is about."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.numbers import count, number
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.verify import Verification, verify

MOST_ANSWERS = 10_000
"""Certificates that a report recomputes at most."""


@dataclass(frozen=True)
class Checked:
    """The result.

    Attributes:
        found: what was recomputed, or None.
        why: why nothing was, "" where something was.
        stated: where the controller was not repeated because verification was skipped, or because
            its code may not run, what it stated itself at its end, by session.
    """

    found: Verification | None
    why: str = ""
    stated: dict[int, dict[str, Any]] | None = None

    @property
    def verdict(self) -> str:
        """`true`, `false` or `not verified`."""
        return self.found.verdict if self.found is not None else "not verified"

    @property
    def outcomes(self) -> dict[int, dict[str, Any]]:
        """What the answers came to, by session of the robot, as a replay computes it."""
        repeated = self.found.outcomes if self.found is not None else {}
        return repeated or self.stated or {}

    @property
    def unjudged(self) -> list[str]:
        """Parts of the log that verdicts rest on and that could not be verified, with reasons."""
        if self.found is None:
            return [] if self.stated is not None else [f"claims: {self.why}"]
        return [
            f"{name}: {reason}"
            for name, each in sorted(self.found.claims.counts.items())
            for reason in each.unverified
            if name.startswith(RESTS_ON)
        ]

    @property
    def gaps(self) -> list[str]:
        """What the head of the page has to state of it."""
        unjudged = [f"Not verified: {each}." for each in self.unjudged]
        if self.stated is not None:
            rests = "The verdict on the task rests on the controller's own summary."
            unjudged = [f"{self.why}. {rests}" if self.why else rests, *unjudged]
        if self.found is not None and self.found.claims.left_out:
            claims = self.found.claims
            sample = count(claims.answers - claims.left_out)
            of = f"{sample} of {count(claims.answers)} answers, a random sample"
            unjudged.append(f"Certificates were recomputed of {of}; `hoap3 verify --all` has all.")
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
            "false_claims": sorted(name for name, each in claims.counts.items() if each.false),
            "unjudged": self.unjudged,
        }


def skip(controller: Log | None) -> Checked:
    """Nothing verified, because the user skipped it; with what the controller's log states."""
    return Checked(None, "Not verified: skipped by --no-verify", _stated(controller))


def _stated(controller: Log | None) -> dict[int, dict[str, Any]]:
    """The newest summary of each session in the log of a controller."""
    stated: dict[int, dict[str, Any]] = {}
    for record in controller.records(Kind.SUMMARY) if controller else ():
        with suppress(ValueError, RecursionError, KeyError, TypeError):
            content = json.loads(record.payload)
            stated[int(content["session_id"])] = content
    return stated


def _names_code(controller: Log) -> bool:
    """Whether the controller is named by a dotted path, so that it is not part of this package."""
    return ":" in str((controller.settings or {}).get("controller", ""))


RESTS_ON = ("summary", "session", "event", "reset", "description", "config", "log of")
"""How claims begin whose parts of a log verdicts rest on."""


def check_logs(
    path: Path,
    logs: Mapping[str, Log],
    say: Callable[[str], None] = lambda _: None,
    *,
    allow_code: bool = False,
) -> Checked:
    """Verify the logs of a run, with the controller repeated.

    Args:
        path: of the run; one that cannot be verified says why.
        logs: by side.
        say: takes progress.
        allow_code: import what the log names by a dotted path.
    """
    options: dict[str, Any] = {"repeat": True, "allow_code": allow_code, "opened": logs}
    try:
        found = verify(path, say, **options, most_answers=MOST_ANSWERS)
    except LogError as error:
        return Checked(None, str(error))
    controller = logs.get("controller")
    if found.outcomes or controller is None or allow_code or not _names_code(controller):
        return Checked(found)
    return Checked(found, stated=_stated(controller))
