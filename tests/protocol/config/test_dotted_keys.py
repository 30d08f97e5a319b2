"""Names with dots and other separators in dotted keys."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hoap3.protocol.config.dotted_keys import join_key, split_key
from hoap3.protocol.config.settings import Settings, apply_overrides, parse
from hoap3.protocol.errors import ConfigError

LINES = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1)


@given(st.lists(LINES, min_size=1))
@example(["a.b", "c"])
@example(['"', "=", "a=b", ".", "é", "a b"])
def test_a_key_has_the_parts_that_it_was_made_of(parts):
    assert split_key(join_key(parts)) == parts


@pytest.mark.parametrize("key", ["", '"', '"a', '"a"b', "a\nb", "\r", "a" * 200_000])
def test_what_is_no_key_stays_as_it_is(key):
    assert split_key(key) in ([key], [])


@pytest.mark.parametrize("name", ["a.b", "a=b", "a/b", "a b", "true", "1", "-", "#x", 'a"b', "é"])
def test_any_name_can_be_set(name):
    key = join_key(["kp", name])
    assert apply_overrides({}, [f"{key}=2.5"]) == {"kp": {name: 2.5}}


class Inner(Settings):
    kp: dict[str, float]


def test_errors_show_a_key_that_can_be_set():
    with pytest.raises(ConfigError) as caught:
        parse(Inner, {"kp": {"a.b": "x"}}, "a.yaml")
    assert caught.value.key == 'kp."a.b"'
