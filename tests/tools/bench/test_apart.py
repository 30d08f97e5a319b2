"""A question in a process of its own: answered, ended, or dead."""

from __future__ import annotations

import os

import pytest

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.bench.pushes.apart import answer_within


def is_even(number: int) -> bool:
    return number % 2 == 0


def never() -> bool:
    while True:
        pass


def die() -> bool:
    os._exit(3)


def test_an_answer_is_told():
    assert answer_within(60, is_even, 4) is True
    assert answer_within(60, is_even, 5) is False


def test_who_never_answers_is_ended():
    assert answer_within(1, never) is None


def test_who_dies_is_no_answer():
    with pytest.raises(Hoap3Error, match="code 3"):
        answer_within(60, die)
