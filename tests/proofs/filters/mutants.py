"""Faults planted into the text of the kernels, one at a time: a run in few bits must find each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple


class Mutant(NamedTuple):
    """A fault: what it is, and which part of the text becomes what."""

    what: str
    before: str
    after: str


MUTANTS = (
    Mutant(
        "an off-by-one in the braking law",
        "change * steps * (steps - 1.0) / 2.0) / steps",
        "change * steps * (steps + 1.0) / 2.0) / steps",
    ),
    Mutant("a step of braking too few", "max(1.0, math.ceil((", "max(1.0, math.floor(("),
    Mutant(
        "the last step faster than can be braked",
        "last = min(max(room, 0.0) / T, acceleration * T)",
        "last = max(room, 0.0) / T",
    ),
    Mutant(
        "half a period forgotten in what braking takes",
        "0.5 * wanted * (wanted / acceleration + T) + acceleration * T * T / 8.0",
        "0.5 * wanted * (wanted / acceleration)",
    ),
    Mutant("no limit of acceleration", "within(within(w, -speed, speed), least, most)",
           "within(w, -speed, speed)"),
    Mutant("no limit of velocity", "within(within(w, -speed, speed), least, most)",
           "within(w, least, most)"),
    Mutant("no end of the range", "return within(q + w * T, lower, upper), w",
           "return q + w * T, w"),
    Mutant("a setpoint taken over at any speed", "abs(w) <= speed + slack", "abs(w) < math.inf"),
    Mutant("a setpoint taken over at any acceleration", "abs(w - v) <= change + slack",
           "abs(w - v) < math.inf"),
    Mutant(
        "a setpoint taken over although the joint cannot stop",
        "return w <= approach_speed(w, upper - q, upper, speed, brake, T)",
        "return True",
    ),
    Mutant("the wrong wall", "-approach_speed(-w, q - lower, lower,",
           "-approach_speed(-w, upper - q, upper,"),
    Mutant("what is no number let through", "if math.isnan(setpoint) or not abs(s) < math.inf:",
           "if False:"),
)  # fmt: skip


def planted(texts: Sequence[str], mutant: Mutant) -> list[str]:
    """The texts with a fault.

    Raises:
        ValueError: what it replaces does not stand there exactly once.
    """
    if sum(text.count(mutant.before) for text in texts) != 1:
        raise ValueError(f"{mutant.before!r} does not stand in the kernels exactly once")
    return [text.replace(mutant.before, mutant.after) for text in texts]


def look_for(
    texts: Sequence[str], look: Callable[[Sequence[str]], str], tell: Callable[[str, str], None]
) -> None:
    """Plant each fault, and tell what is found of it.

    Args:
        texts: sources of the kernels.
        look: what is wrong with such sources, or "".
        tell: takes what the fault is, and what was found.
    """
    for mutant in MUTANTS:
        tell(mutant.what, look(planted(texts, mutant)))
