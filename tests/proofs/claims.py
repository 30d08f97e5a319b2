"""What a proof came to: claim by claim."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Claim:
    """Something that was looked into.

    Attributes:
        name: what is claimed.
        holds: whether it is so.
        detail: how much was looked at, or what is wrong.
    """

    name: str
    holds: bool
    detail: str


@dataclass
class Proof:
    """Claims about one part of the product, and faults that were planted into it.

    Attributes:
        subject: which part.
        claims: what is said of it.
        found, missed: planted faults that the proof finds, and those that it does not.
    """

    subject: str
    claims: list[Claim] = field(default_factory=list)
    found: dict[str, str] = field(default_factory=dict)
    missed: list[str] = field(default_factory=list)

    @property
    def holds(self) -> bool:
        """Whether every claim holds, and every fault is found."""
        return all(claim.holds for claim in self.claims) and not self.missed

    def note(self, name: str, holds: bool, detail: str) -> None:
        """Add a claim."""
        self.claims.append(Claim(name, holds, detail))

    def fault(self, name: str, wrong: str) -> None:
        """Add a planted fault, and what is wrong with it, "" where nothing was found."""
        if wrong:
            self.found[name] = wrong
        else:
            self.missed.append(name)

    def lines(self) -> list[str]:
        """For people."""
        told = [f"{self.subject}: {'holds' if self.holds else 'does not hold'}"]
        told += [
            f"  {'yes' if claim.holds else 'NO '}  {claim.name}: {claim.detail}"
            for claim in self.claims
        ]
        faults = len(self.found) + len(self.missed)
        if faults:
            told.append(f"  planted faults: {len(self.found)} of {faults} found")
        told += [f"  NOT FOUND: {name}" for name in self.missed]
        return told

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        claims = [vars(claim) for claim in self.claims]
        return {
            "subject": self.subject,
            "holds": self.holds,
            "claims": claims,
            "faults": {"found": self.found, "missed": self.missed},
        }
