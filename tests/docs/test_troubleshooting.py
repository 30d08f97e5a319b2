"""docs/troubleshooting.md knows every reason that the code gives."""

from __future__ import annotations

import ast
import ctypes
import errno
import re

import pytest
from pages import HOUSE, blocks, table

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import AuthorityError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.realtime import Measure, _lock_memory, _pin, _schedule
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS

PAGE = "troubleshooting.md"
QUOTED = [
    line for block in blocks(PAGE) if block.language == "text" for line in block.text.split("\n")
]


def test_every_kind_of_rejection_is_explained_under_its_number():
    rows = table(PAGE, "Setpoints are rejected")
    listed = {int(row["number"]): row["kind"].strip("`") for row in rows}
    assert listed == dict(enumerate(REJECTION_KINDS))


def test_every_reason_of_a_stop_is_explained():
    rows = table(PAGE, "Safe stop")
    listed = {word.strip(" `") for row in rows for word in next(iter(row.values())).split(",")}
    reasons = {name for name in Event.schema.constants if name.startswith("REASON_")}
    assert listed == {name.removeprefix("REASON_").lower().replace("_", " ") for name in reasons}


class Refuses:
    """A C library that locks no memory."""

    def mlockall(self, _: int) -> int:
        ctypes.set_errno(errno.ENOMEM)
        return -1


def test_refusals_are_quoted_as_they_are_printed(monkeypatch):
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("hoap3.protocol.runtime.realtime.resource.setrlimit", lambda *_: None)
    monkeypatch.setattr("hoap3.protocol.runtime.realtime.os.sched_setscheduler", refuse)
    monkeypatch.setattr("hoap3.protocol.runtime.realtime.claim_cpu", lambda: None)
    measures: list[Measure] = [
        _schedule(RealtimeSettings()),
        _lock_memory(Refuses()),
        _pin(RealtimeSettings()),
    ]
    for measure in measures:
        assert str(measure) in QUOTED


def texts(file: str) -> set[str]:
    """Every text in a source file, with `…` for what is filled in."""
    found = set()
    for node in ast.walk(ast.parse((HOUSE / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        elif isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
            found.add("".join(map(str, parts)))
    return found


IN_LINK = "protocol/link/zenoh_link.py"
PLACES = {
    "waiting for robot … at …": "remote_controller/service.py",
    "… is in use: another robot runs there. Stop it, or set link.listen to a free port": IN_LINK,
    "nobody answers at …: is the robot running, and is this its endpoint?": IN_LINK,
    "a robot called … is alive already; stop it, or give this one another name": IN_LINK,
}


@pytest.mark.parametrize("text", PLACES)
def test_messages_are_quoted_as_they_stand_in_the_code(text):
    filled_in = re.compile(r"'hoap3'|tcp/[\d.:]+\d")
    assert text in {filled_in.sub("…", line.removeprefix("error: ")) for line in QUOTED}
    assert text in texts(PLACES[text])


def test_the_holder_of_authority_is_quoted_as_the_error_says_it():
    assert f"error: {AuthorityError('hoap3', 'qp12-laptop-4711')}" in QUOTED
