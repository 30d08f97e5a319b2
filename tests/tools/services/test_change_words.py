"""What `hoap3 change` takes as words, before any robot is asked."""

from __future__ import annotations

import pytest

from hoap3.protocol.errors import UsageError
from hoap3.tools.cli.requests import change


@pytest.mark.parametrize("word", ["gama", "0.8", '"gamma"', "", "=0.8"])
def test_a_word_that_is_neither_is_told_of_keys_and_values(word: str) -> None:
    with pytest.raises(UsageError, match="KEY=VALUE"):
        change([word])


@pytest.mark.parametrize("word", ["{", "[1]", ' {"gamma": }'])
def test_what_begins_as_json_is_told_of_json(word: str) -> None:
    with pytest.raises(UsageError, match="JSON") as refused:
        change([word])
    assert "KEY=VALUE" not in str(refused.value)
