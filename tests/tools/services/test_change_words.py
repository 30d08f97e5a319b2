"""What `hoap3 change` takes as words, before any robot is asked."""

from __future__ import annotations

import pytest

from hoap3.protocol.errors import UsageError
from hoap3.tools.cli.requests import change


@pytest.mark.parametrize(
    ("word", "remedy"),
    [
        *((word, "KEY=VALUE") for word in ("gama", "0.8", '"gamma"', "", "=0.8")),
        *((word, "JSON") for word in ("{", "[1]", ' {"gamma": }')),
    ],
)
def test_a_word_that_is_neither_is_refused(word: str, remedy: str) -> None:
    with pytest.raises(UsageError, match=remedy):
        change([word])
