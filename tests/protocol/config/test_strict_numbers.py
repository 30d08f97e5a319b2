"""Settings take numbers where numbers belong, and nothing that only looks like one."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
from pydantic import Field

from hoap3.protocol.config.settings import Settings, apply_overrides, parse, parse_yaml
from hoap3.protocol.errors import ConfigError


class Inner(Settings):
    """Below a key."""

    share: float = Field(0.5, gt=0, le=1)


class Numbers(Settings):
    """Numbers in every place where settings have them."""

    budget: int = Field(60, ge=1, le=1000)
    rate: float = Field(1.0, gt=0)
    axis: tuple[float, float] = (0.0, 1.0)
    targets: tuple[float, ...] = ()
    by_name: dict[str, float] = Field(default_factory=dict)
    maybe: Annotated[int, Field(ge=0)] | None = None
    either: int | str = 1
    inner: Inner = Inner()
    several: tuple[Inner, ...] = ()
    on: bool = True


@pytest.mark.parametrize(
    ("key", "content"),
    [
        ("budget", {"budget": True}),
        ("budget", {"budget": "60"}),
        ("budget", {"budget": 60.0}),
        ("rate", {"rate": True}),
        ("rate", {"rate": "1.5"}),
        ("axis.1", {"axis": [0, True]}),
        ("targets.0", {"targets": [False]}),
        ("by_name.knee", {"by_name": {"knee": True}}),
        ("maybe", {"maybe": True}),
        ("either", {"either": True}),
        ("inner.share", {"inner": {"share": True}}),
        ("several.0.share", {"several": [{"share": True}]}),
    ],
)
def test_true_and_text_are_no_numbers(key: str, content: dict[str, Any]) -> None:
    with pytest.raises(ConfigError) as refused:
        parse(Numbers, content, "mine.yaml")
    assert refused.value.key == key


def test_whole_numbers_pass_for_real_ones_and_words_for_truth() -> None:
    content = {"rate": 2, "axis": [1, 0.5], "either": "auto", "inner": {"share": 1}, "on": False}
    found = parse(Numbers, content, "mine.yaml")
    assert (found.rate, found.axis, found.inner.share, found.on) == (2.0, (1.0, 0.5), 1.0, False)


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "+1e-3", "1.e-3", ".1e-2", "0.001", "1.0e-3"])
def test_an_exponent_needs_no_point(text: str) -> None:
    assert parse_yaml(f"rate: {text}", "mine.yaml") == {"rate": 1e-3}
    assert apply_overrides({}, [f"rate={text}"]) == {"rate": 1e-3}


@pytest.mark.parametrize("text", ["1e", "e3", "1e3x", "0x1e3", "'1e-3'"])
def test_what_only_begins_like_a_number_is_none(text: str) -> None:
    assert not isinstance(parse_yaml(f"rate: {text}", "mine.yaml")["rate"], float)
