"""Joints that follow others: <mimic> of a URDF, whose chains are resolved to one master each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from hoap3.protocol.errors import DescriptionError, did_you_mean


@dataclass(frozen=True)
class Mimic:
    """What a follower says: q = multiplier · q_joint + offset [rad or m]."""

    joint: str
    multiplier: float
    offset: float

    @classmethod
    def read(cls, where: str, given: Mapping[str, str]) -> Self:
        """Read the attributes of a <mimic>, whose numbers are checked already.

        Raises:
            DescriptionError: a multiplier of 0, with which nothing moves.
        """
        mimic = cls(
            given.get("joint", ""),
            float(given.get("multiplier", "1")),
            float(given.get("offset", "0")),
        )
        if mimic.multiplier == 0.0:
            raise DescriptionError(
                f"{where}: <mimic multiplier> is 0, so that it does not move. Write another "
                f'number, or type="fixed" with an <origin> at {mimic.offset}.'
            )
        return mimic


@dataclass(frozen=True)
class Follower:
    """A joint that follows an independent one: q = ratio · q_master + offset [rad or m]."""

    name: str
    master: str
    ratio: float
    offset: float

    def seen_by_master(self, lower: float, upper: float) -> tuple[float, float]:
        """The positions of the master, from and to, at which this one is between two of its own."""
        first, last = ((end - self.offset) / self.ratio for end in (lower, upper))
        return min(first, last), max(first, last)


def resolve(mimics: Mapping[str, Mimic | None]) -> dict[str, Follower]:
    """The master of each follower, through other followers if need be.

    Args:
        mimics: of all joints that are not fixed, by name; None of those that follow no other.

    Raises:
        DescriptionError: a joint follows what is no movable joint, or itself at last.
    """
    followers = {}
    for name, mimic in mimics.items():
        if mimic is not None:
            followers[name] = _follow(name, mimic, mimics)
    return followers


def _follow(name: str, mimic: Mimic, mimics: Mapping[str, Mimic | None]) -> Follower:
    ratio, offset, passed = 1.0, 0.0, [name]
    here: Mimic | None = mimic
    while here is not None:
        follower, master = passed[-1], here.joint
        if master in passed:
            chain = " → ".join([*passed, master])
            raise DescriptionError(
                f"URDF joint {name!r}: it follows itself ({chain:.400}). "
                f"Remove the <mimic> of {master!r}."
            )
        if master not in mimics:
            raise DescriptionError(
                f"URDF joint {follower!r}: <mimic joint> is {master[:60]!r}, no movable joint. "
                + did_you_mean(master, mimics, 'Write <mimic joint=".."> with the name of one.')
            )
        offset += ratio * here.offset
        ratio *= here.multiplier
        passed.append(master)
        here = mimics[master]
    if ratio == 0.0 or not math.isfinite(ratio) or not math.isfinite(offset):
        raise DescriptionError(
            f"URDF joint {name!r}: it follows {passed[-1]!r} by {ratio} and {offset}, through "
            f"{len(passed) - 2} others. Correct the multipliers and offsets of their <mimic>."
        )
    return Follower(name, passed[-1], ratio, offset)
