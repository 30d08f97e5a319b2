"""What stalls of the host come to, and whether a limit of CPU time is why.

Linux hands CPU time to a group that is limited, such as a container or a virtual machine, for
periods of 100 ms; one that has used up its share waits for the next. So these stalls end at the
same point of every 100 ms, and others anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.tools.machine.stalls import Stall

PERIOD_NS = 100_000_000
"""The kernel's default, `cpu.cfs_period_us`."""
LONG_NS = 1_000_000
NEAR_NS = 1_000_000
NEWEST = 100
"""That are compared: two clocks drift apart by some milliseconds in ten minutes."""
SURE = 1e-6
"""Stalls that end anywhere would look like that so often at the most."""


def figures(stalls: Sequence[Stall]) -> dict[str, Any]:
    """How many, how long together, the longest; `long` ones, and those that end `in_step`."""
    lengths = [(stall.end - stall.start) / 1e6 for stall in stalls]
    return {
        "n": len(lengths),
        "total_ms": sum(lengths),
        "longest_ms": max(lengths, default=0.0),
        **ended_in_step(stalls),
    }


def ended_in_step(stalls: Iterable[Stall]) -> dict[str, int]:
    """Of the newest `long` stalls, how many end at the same point of each 100 ms, to 1 ms.

    Long is 1 ms. What several CPUs saw at the same time is one stall. `in_step` is 0 where chance
    may do as much.
    """
    ends = np.sort([stall.end for stall in stalls if stall.end - stall.start >= LONG_NS])
    ends = ends[np.diff(ends, prepend=-PERIOD_NS) > NEAR_NS][-NEWEST:]
    if not ends.size:
        return {"long": 0, "in_step": 0}
    apart = np.abs(ends[:, None] - ends) % PERIOD_NS
    near = np.minimum(apart, PERIOD_NS - apart) < NEAR_NS
    most = int(near.sum(axis=1).max())
    chance = ends.size * _at_least(most - 1, ends.size - 1, 2.0 * NEAR_NS / PERIOD_NS)
    return {"long": int(ends.size), "in_step": most if chance < SURE else 0}


def _at_least(least: int, n: int, p: float) -> float:
    """How likely so many of n are, each of probability p."""
    return sum(math.comb(n, k) * p**k * (1.0 - p) ** (n - k) for k in range(least, n + 1))


def limited(found: Mapping[str, Any]) -> str:
    """What people should know of figures whose stalls end in step; "" where they do not."""
    if not found.get("in_step"):
        return ""
    share = f"{found['in_step']} of the last {found['long']} that took 1 ms or more"
    return (
        f"{share} end at the same point of each 100 ms: the host limits this machine's CPU time "
        "(`hoap3 help realtime_rights`)"
    )
