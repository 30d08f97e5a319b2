"""A question in a process of its own: answered, ended, or dead."""

from __future__ import annotations

import os
import threading

import pytest

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.bench.pushes.apart import answer_within


def is_even(number: int) -> bool:
    return number % 2 == 0


def never() -> bool:
    threading.Event().wait()
    return True


def die() -> bool:
    os._exit(3)


def test_an_answer_is_told():
    assert answer_within(60.0, is_even, 4) is True
    assert answer_within(60.0, is_even, 5) is False


def test_who_never_answers_is_ended():
    assert answer_within(0.5, never) is None


def test_who_dies_is_no_answer():
    with pytest.raises(Hoap3Error, match="code 3"):
        answer_within(60.0, die)
