"""What all fuzzers share: mutations of bytes, text and trees, and limits of time and memory.

A fuzzer takes small valid inputs, its corpus, changes them, and hands them to a decoder of the
product. The decoder may take an input or refuse it by an error of ours; anything else is a finding,
and so is more than a second of CPU time, or more than `MOST_MIB` of memory. Every run of one seed
is the same.
"""

from __future__ import annotations

import copy
import json
import random
import resource
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hoap3.protocol.errors import Hoap3Error

CORPUS = Path(__file__).parent / "corpus"
FEW = 10  # inputs, of which all may be taken
MOST_S = 1.0  # of CPU time, for one input
MOST_MIB = 1024  # of addresses, for all inputs of a fuzzer
WORDS = (
    "null",
    "true",
    "nan",
    ".inf",
    "-1",
    "0",
    "1e308",
    "-0.0",
    "18446744073709551616",
    "''",
    "[]",
)
WORDS += (
    "{}",
    "[[]]",
    "{a: 1}",
    "'\\0'",
    "\u202e",
    "é",
    "..",
    "/dev/zero",
    "a:b",
    "*a",
    "&a b",
    "!!python/x",
)
NUMBERS = (0, 1, -1, 0.5, -0.0, 1e-320, 1e308, -1e308, 2**31, 2**63, 2**64, -(2**63), 10**400)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    "",
    "a",
    "\0",
    "x" * 5000,
    [],
    {},
    [[]],
    [None],
    {"": 0},
)


def amount(quick: int, long: int = 10_000) -> Any:
    """Parametrises a test by how many inputs it makes: a few by default, many with `-m long`."""
    marked = pytest.param(long, marks=pytest.mark.long)
    return pytest.mark.parametrize("count", [quick, marked])


class TooSlow(BaseException):
    """An input took more than its time."""


@contextmanager
def bounded() -> Iterator[None]:
    """Bounds the memory of this process: beyond `MOST_MIB` more than now is a MemoryError."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(
        resource.RLIMIT_AS, (pages * resource.getpagesize() + (MOST_MIB << 20), hard)
    )
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextmanager
def soon(most_s: float) -> Iterator[None]:
    """Raises `TooSlow` where what happens inside takes more CPU time than that [s]."""

    def late(*_: object) -> None:
        raise TooSlow

    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, most_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


class Findings:
    """What became of all inputs of a fuzzer.

    Attributes:
        outcomes: how many were taken, and how many refused by which error.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._found = folder, dict[str, str]()
        self.outcomes = Counter[str]()

    def judge(
        self,
        decode: Callable[[Any], object],
        given: Any,
        allowed: tuple[type[Exception], ...] = (),
        most_s: float = MOST_S,
    ) -> None:
        """Decode an input; note what is wrong with how that ends.

        Args:
            decode: of the product.
            given: for it.
            allowed: errors that are its way to refuse, besides ours.
            most_s: of CPU time that it may take [s].
        """
        try:
            with soon(most_s):
                decode(given)
            outcome = "taken"
        except (Hoap3Error, *allowed) as error:
            outcome = type(error).__name__
            if not str(error).strip():
                self._note(given, f"{outcome} without a word")
        except (Exception, TooSlow) as error:  # noqa: BLE001 - findings
            outcome = "wrong"
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(last.filename).name}:{last.lineno}"
            self._note(given, f"{type(error).__name__} at {where}: {error!s:.200}")
        self.outcomes[outcome] += 1

    def _note(self, given: Any, what: str) -> None:
        """Keep the first input of each kind of finding."""
        if what.partition(": ")[0] in self._found:
            return
        raw = given if isinstance(given, bytes) else str(given).encode(errors="backslashreplace")
        path = self._folder / f"finding_{len(self._found)}"
        path.write_bytes(raw)
        self._found[what.partition(": ")[0]] = f"{what}\n    {path}: {raw[:300]!r}"

    def check(self, count: int) -> None:
        """Fail where something was found, or where none of many inputs was refused."""
        print(dict(self.outcomes.most_common()))
        assert not self._found, "\n".join(self._found.values())
        assert sum(self.outcomes.values()) == count
        assert self.outcomes["taken"] < count or count < FEW


def corpus(folder: str, *, ending: str = "") -> list[bytes]:
    """The files of a part of the corpus, in the order of their names."""
    found = sorted((CORPUS / folder).glob(f"*{ending}"))
    assert found, folder
    return [path.read_bytes() for path in found]


def mutate_bytes(draw: random.Random, data: bytes, others: Iterable[bytes] = ()) -> bytes:
    """One to four changes of some bytes: flipped, set, cut, doubled, or of another input."""
    out = bytearray(data)
    pool = list(others) or [data]
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        at = draw.randrange(len(out) + 1)
        end = min(len(out), at + draw.choice((1, 2, 4, 8, 16, 100)))
        match draw.randrange(8):
            case 0 if end > at:
                out[at] ^= 1 << draw.randrange(8)
            case 1:
                out[at:end] = draw.randbytes(end - at)
            case 2:
                del out[at:end]
            case 3:
                out[at:at] = out[at:end] * draw.choice((1, 2, 50))
            case 4:
                out[at:end] = draw.choice((b"\0", b"\xff", b"\x7f", b"\x80")) * (end - at)
            case 5:
                del out[at:]
            case 6:
                other = draw.choice(pool)
                start = draw.randrange(len(other) + 1)
                out[at:end] = other[start : start + draw.choice((4, 40, 400))]
            case _:
                out[at:at] = draw.randbytes(draw.choice((1, 3, 9)))
    return bytes(out)


def mutate_text(draw: random.Random, text: str) -> str:
    """Changes of whole words and lines of a text, such as YAML or XML."""
    for _ in range(draw.choice((1, 1, 2, 3))):
        lines = text.splitlines(keepends=True) or [""]
        at = draw.randrange(len(lines))
        line = lines[at]
        words = [word for word in line.replace("=", " = ").replace('"', ' " ').split(" ") if word]
        match draw.randrange(7):
            case 0:
                del lines[at]
            case 1:
                lines.insert(draw.randrange(len(lines) + 1), line)
            case 2 if words:
                lines[at] = line.replace(draw.choice(words), draw.choice(WORDS), 1)
            case 3 if words:
                lines[at] = line.replace(draw.choice(words), str(draw.choice(NUMBERS)), 1)
            case 4:
                lines[at] = draw.choice(("  ", "\t", "- ", "? ", "")) + line.lstrip()
            case 5:
                other = draw.choice(lines).split()
                lines[at] = line.replace(
                    draw.choice(words or ["\n"]), draw.choice(other or [""]), 1
                )
            case _:
                raw = mutate_bytes(draw, line.encode())
                lines[at] = raw.decode(errors="replace")
        text = "".join(lines)
    return text


def mutate_tree(draw: random.Random, tree: Any) -> Any:
    """A copy of what JSON or YAML says, in which one to three places are something else."""
    tree = json.loads(json.dumps(tree))
    for _ in range(draw.choice((1, 1, 2, 3))):
        places = list(_places(tree))
        if not places:
            return copy.deepcopy(draw.choice(VALUES))
        place, key = draw.choice(places)
        match draw.randrange(6):
            case 0:
                place[key] = copy.deepcopy(draw.choice(VALUES))
            case 1:
                place[key] = draw.choice(NUMBERS)
            case 2 if isinstance(place, dict):
                place[draw.choice(("", "a", f"{key}s", "kind", "parameters"))] = place.pop(key)
            case 3 if isinstance(place, dict):
                del place[key]
            case 4:
                other, name = draw.choice(places)
                place[key] = json.loads(json.dumps(other[name]))
            case _:
                place[key] = _near(draw, place[key])
    return tree


def _near(draw: random.Random, value: Any) -> Any:
    """Something of the same kind, if possible."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int) and abs(value) > 2**64:
        return -value
    if isinstance(value, int | float):
        return draw.choice((-value, value * 1e6, value * 1e-6, value + 1, str(value), [value]))
    if isinstance(value, str):
        return draw.choice(
            (value.upper(), value[1:], value * 2, f"{value}\0", f"./{value}", [value])
        )
    if isinstance(value, list):
        return draw.choice((value[1:], value * 2, value[::-1], value[:1] * 300, {"a": value}))
    return draw.choice(([value], list(value), {**value, "x" * 99: value}))


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every value of a tree as the container and the key under which it stands."""
    if not isinstance(tree, dict | list):
        return
    for key, value in list(tree.items() if isinstance(tree, dict) else enumerate(tree)):
        yield tree, key
        yield from _places(value)
