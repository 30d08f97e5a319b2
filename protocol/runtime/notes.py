"""What a service says to people, by how much it matters: text that knows its kind.

A plain `str` is always shown.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import ClassVar, Literal

from hoap3.protocol.runtime.realtime import Measure

NoteKind = Literal["detail", "compiling", "routine", "said", "not granted", "damaged", "unserved"]
"""How much a text matters, as processes name it."""


class Note(str):
    """Text of one kind; it is a `str`, so whoever takes any text takes it.

    Attributes:
        news: the kind, as it is named between processes.
    """

    news: ClassVar[NoteKind] = "said"


class Detail(Note):
    """Shown with `--verbose` only, such as each kernel and each request to the system."""

    news: ClassVar[NoteKind] = "detail"


class Routine(Note):
    """The normal course of a service: shown where it runs by itself, by `run` with `--verbose`."""

    news: ClassVar[NoteKind] = "routine"


class NotGranted(Note):
    """What the operating system did not grant; both services of a `run` may say the same."""

    news: ClassVar[NoteKind] = "not granted"


class Unserved(Note):
    """What an observer cannot serve, though it was asked to: a finding, as a lost log is."""

    news: ClassVar[NoteKind] = "unserved"


def told(measures: Iterable[Measure]) -> Iterator[Note]:
    """Each measure as a detail, and in one line those that were not granted, if any."""
    missing = []
    for measure in measures:
        yield Detail(measure)
        if not measure.obtained:
            missing.append(f"{measure.name} ({measure.detail})")
    if missing:
        yield NotGranted(f"not granted by the system: {', '.join(missing)}")
