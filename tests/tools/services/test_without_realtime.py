"""What `--no-realtime` changes, also where a config says nonsense of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from hoap3.protocol.errors import ConfigError
from hoap3.tools.services.configs import load_controller_config, load_emulator_config

SIDES = pytest.mark.parametrize(
    ("read", "name"), [(load_emulator_config, "hoap3"), (load_controller_config, "qp12")]
)


@SIDES
@pytest.mark.parametrize("wrong", ["realtime=5", "realtime=null", "realtime=[1]"])
def test_what_is_no_mapping_is_named(read: Callable[..., Any], name: str, wrong: str) -> None:
    with pytest.raises(ConfigError, match="realtime"):
        read(name, [wrong], realtime=False)


@SIDES
def test_an_ordinary_process_keeps_what_else_it_was_told(
    read: Callable[..., Any], name: str
) -> None:
    config, _ = read(name, ["realtime.priority=7"], realtime=False)
    assert (config.realtime.policy, config.realtime.priority) == ("none", 7)
