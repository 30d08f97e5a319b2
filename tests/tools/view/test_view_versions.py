"""A robot of an earlier version of the wire is not shown, and it is said why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import zenoh
from support.command_bench import endpoint
from support.log_samples import describe

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError
from hoap3.protocol.link.zenoh_session import key, open_session
from hoap3.tools.view.sources.live import Live


@pytest.fixture
def old_robot() -> Iterator[str]:
    """One that knows the keys of version 1 alone; where it listens."""
    where = endpoint()
    session = open_session(LinkSettings(listen=(where,)))

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, describe(3).to_json())

    kept: list[Any] = [session.declare_queryable(key("sample", "ask/*"), answer)]
    kept.append(session.liveliness().declare_token(key("sample", "alive")))
    yield where
    session.close()


def test_a_robot_of_version_1_is_said_to_be_one(old_robot):
    with pytest.raises(LinkError, match="version 1") as refusal:
        Live("sample", old_robot)
    assert "hoap3 record" in str(refusal.value)


def test_a_robot_that_is_not_there_is_not_said_to_be_old(old_robot):
    with pytest.raises(LinkError) as refusal:
        Live("another", old_robot)
    assert "version" not in str(refusal.value)
