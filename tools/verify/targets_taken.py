"""Messages of live targets that a controller took lie within the range that its config gives."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.verify.claims import Claims

POSITION = 3  # numbers of a point that `lower_m` and `upper_m` limit


def check_targets(records: Iterable[Record], parameters: Mapping[str, Any], claims: Claims) -> None:
    """Check the positions of all messages that were taken; `claims` takes the tick before each."""
    ranges = {str(each.get("name", "target")): each for each in _live(parameters)}
    if not ranges:
        return
    names: list[str] = []
    tick = -1
    for kind, _, payload in records:
        if kind == Kind.SESSION:
            names = json.loads(payload).get("targets") or []
        elif kind == Kind.STATE:
            (tick,) = State.scalars(payload, "tick")
        elif kind == Kind.TARGET:
            target = Target.like(payload)
            target.load(payload)
            name = names[target.target] if target.target < len(names) else ""
            given = ranges.get(name, {})
            points = target.values.reshape(target.points, target.dimension)[:, :POSITION]
            for key, sign in (("lower_m", -1.0), ("upper_m", 1.0)):
                if given.get(key) is not None:
                    off = sign * (points - np.array(given[key], float))
                    claims.at_most("live target in range", tick, float(off.max()), 0.0, 0.0)


def _live(content: Any) -> Iterator[Mapping[str, Any]]:
    """All settings of live targets in a config."""
    if isinstance(content, Mapping):
        if content.get("kind") == "live":
            yield content
        for value in content.values():
            yield from _live(value)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _live(value)
