"""What a connection sends, checked before: changes, which it also describes, points, ticks."""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hoap3.protocol.errors import BadProblemError, UsageError
from hoap3.protocol.link.session_limits import MAX_REQUEST_BYTES
from hoap3.protocol.messages import MAX_ELEMENTS


def numbers(given: ArrayLike, what: str) -> np.ndarray[Any, Any]:
    """An array of floats.

    Raises:
        BadProblemError: it is none.
    """
    try:
        return np.asarray(given, float)
    except (TypeError, ValueError) as error:
        raise BadProblemError(f"{what} must be numbers (found {given!r:.60})") from error


def request(what: Any, more: Mapping[str, Any]) -> bytes:
    """A change as it is sent; arrays and numbers of numpy become lists and plain numbers.

    Raises:
        UsageError: no mapping of keys, a value that JSON does not have, or too long.
    """
    if not isinstance(what, Mapping | None):
        raise UsageError(f"a change is a mapping of keys to numbers (found {what!r:.60})")
    content = {**(what or {}), **more}
    for key in content:
        if not isinstance(key, str):
            raise UsageError(f"a key of a change is text, such as 'gamma' (found {key!r:.60})")
    try:
        body = json.dumps(content, default=_plain).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise UsageError(f"this change cannot be sent ({error}): give plain numbers") from error
    if len(body) > MAX_REQUEST_BYTES:
        raise UsageError(f"the change has {len(body)} bytes; a robot takes {MAX_REQUEST_BYTES}")
    return body


def describe_change(content: Mapping[str, Any], before: Mapping[str, Any]) -> list[str]:
    """Each value of a change as "gamma: 0.5 → 0.8"; without the old one where it is not known.

    Args:
        content: keys and their new values, nested or with dots.
        before: what could be changed, with the values before the change.
    """
    lines = []
    for path, new in _leaves(content):
        key = ".".join(path)
        places = (path, key.split("."), (path[0], *path))  # weights of tasks are a level deeper
        found = (old for old in map(partial(_value_at, before), places) if old is not None)
        old = next(found, None)
        from_old = "" if old is None or isinstance(old, Mapping) else f"{_short(old)} → "
        if key != "over_s":
            lines.append(f"{key}: {from_old}{_short(new)}")
    return lines


def _leaves(content: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not isinstance(content, Mapping):
        yield path, content
        return
    for key, value in content.items():
        yield from _leaves(value, (*path, str(key)))


def _value_at(content: Any, path: Sequence[str]) -> Any:
    for key in path:
        content = content.get(key) if isinstance(content, Mapping) else None
    return content


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)


def _plain(value: Any) -> Any:
    if callable(to_list := getattr(value, "tolist", None)):
        return to_list()
    raise UsageError(f"a change has numbers (found {value!r:.60})")


def whole(given: Any, what: str) -> int:
    """A number of ticks.

    Raises:
        BadProblemError: it is none.
    """
    try:
        return operator.index(given)
    except TypeError as error:
        raise BadProblemError(f"{what} must be a whole number (found {given!r:.60})") from error


def check_limits(points: np.ndarray[Any, Any], target: Mapping[str, Any]) -> None:
    """Refuse points that a controller would refuse because they are out of a target's limits.

    Args:
        points: (p, dimension).
        target: as `acquire` gives it.

    Raises:
        BadProblemError: names the number, its value and its limits.
    """
    ends = [target.get(key, ()) for key in ("lower", "upper", "layout")]
    for values, lower, upper, name in zip(points.T.tolist(), *ends, strict=False):
        least, most = -math.inf if lower is None else lower, math.inf if upper is None else upper
        for value in values:
            if not least <= value <= most:
                unit = f" {target['unit']}" if target.get("unit") else ""
                raise BadProblemError(
                    f"target {target['name']!r}: {name} is {value:g}{unit}: "
                    f"send {least:g} to {most:g}{unit}"
                )


def check_refused(refused: Mapping[str, int], before: Mapping[str, int]) -> None:
    """Raise if a controller has refused messages since `before`, by reason.

    Raises:
        UsageError: it has.
    """
    new = [f"{name}: {n}" for name, n in refused.items() if n > before.get(name, 0)]
    if new:
        raise UsageError(
            f"the controller refused messages ({', '.join(new)}): send such targets again"
        )


def is_reached(grant: Mapping[str, Any], number: int, errors: list[Mapping[str, Any]]) -> bool:
    """Return whether message `number` has arrived, its target is at rest, and tasks are within."""
    arrived = grant.get("newest", 0) >= number
    at_rest = all(target.get("at_rest") for target in grant["targets"])
    return arrived and at_rest and all(each["within"] for each in errors if each["judged"])


def place(targets: list[Mapping[str, Any]], name: str | None) -> tuple[int, int, int]:
    """Number of a target by its name, numbers of a point of it, and of a rate."""
    names = [str(each["name"]) for each in targets]
    if name is None and len(names) == 1:
        name = names[0]
    if name not in names:
        raise UsageError(f"no live target is called {name!r}; there are {', '.join(names)}")
    at = names.index(name)
    return at, int(targets[at]["dimension"]), int(targets[at]["rates"])


def check(
    points: np.ndarray[Any, Any],
    rates: np.ndarray[Any, Any],
    numbers: tuple[int, int],
    first_tick: int,
    step_ticks: int,
) -> None:
    """Refuse what no controller can take; numbers: of a point, and of its rate."""
    dimension, moves = numbers
    if points.ndim != 2 or points.shape[1] != dimension or not 0 < points.size <= MAX_ELEMENTS:
        raise BadProblemError(
            f"points of shape {points.shape}: expected (p, {dimension}), at most {MAX_ELEMENTS} "
            "numbers"
        )
    if rates.size and rates.shape != (len(points), moves):
        raise BadProblemError(f"rates of shape {rates.shape}: expected ({len(points)}, {moves})")
    if not (np.isfinite(points).all() and np.isfinite(rates).all()):
        raise BadProblemError("points and rates must be finite numbers")
    if not (0 <= first_tick < 2**64 and 1 <= step_ticks < 2**32):
        raise BadProblemError(
            f"first_tick {first_tick} and step_ticks {step_ticks}: expected ≥ 0 and ≥ 1"
        )
