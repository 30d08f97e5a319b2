"""What every property suite is: test methods, and the cases that a subclass has them run over."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeVar

import pytest

Test = TypeVar("Test", bound=Callable[..., None])


@dataclass(frozen=True)
class Value:
    """What a test is run with.

    Attributes:
        given: its arguments, in the order of their names.
        label: what pytest calls them.
        weight: whether it is among what always runs.
    """

    given: tuple[Any, ...]
    label: str
    weight: Literal["usual", "slow", "long"] = "usual"


def over(
    names: str, values: Iterable[Any] | Callable[[Any], Iterable[Value]], long: Iterable[Any] = ()
) -> Callable[[Test], Test]:
    """Have a test method run over values, as `pytest.mark.parametrize` does.

    Args:
        names: of the arguments, with commas between them.
        values: one each, or what makes `Value`s of the suite.
        long: further ones, of weight `long`.
    """

    def marked(test: Test) -> Test:
        test.__dict__.setdefault("over", []).append((names, values, tuple(long)))
        return test

    return marked


class Suite:
    """Base of the suites.

    Attributes:
        cases: what the tests run over; a subclass names its own.
        slow, long: marks for what takes longer and seldom finds what the rest does not; without a
            mark it is left out.
    """

    cases: ClassVar[Sequence[Any]] = ()
    slow: ClassVar[pytest.MarkDecorator | None] = None
    long: ClassVar[pytest.MarkDecorator | None] = None

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Give each test method its arguments; pytest calls it."""
        for names, values, long in getattr(metafunc.function, "over", ()):
            known = (
                values(self) if callable(values) else [Value((each,), str(each)) for each in values]
            )
            known = [*known, *(Value((each,), str(each), "long") for each in long)]
            metafunc.parametrize(names, list(self._parameters(known)))

    def _parameters(self, values: Iterable[Value]) -> Iterable[Any]:
        marks = {"usual": (), "slow": self.slow, "long": self.long}
        for value in values:
            mark = marks[value.weight]
            if mark is not None:
                yield pytest.param(*value.given, id=value.label, marks=mark)
