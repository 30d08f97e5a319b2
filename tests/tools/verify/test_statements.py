"""What a log may hold that must neither be skipped without a word nor run."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

from driven import recorded

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.singularity import LEAVING
from hoap3.tools.verify.statements import check_engagements
from hoap3.tools.verify.verify import Part, _judged

TICKS = 30


def event(name: str, detail: int = 0) -> Record:
    found = Event()
    found.kind, found.detail = Event.schema.constants[name], detail
    return Record(Kind.EVENT, 0, found.dump())


def checked(controller: str, records: list[Record], given: dict[str, Any], *, allow: bool) -> Part:
    def work(part: Part, _: object) -> None:
        check_engagements(records, controller, given, part.claims, allow_code=allow)

    return _judged(Path("log"), work, allow, print)


def test_an_answer_in_a_singularity_that_only_its_log_claims_is_not_verified():
    records, given = recorded("qp12", "hoap3", TICKS)
    session = {**json.loads(records[1].payload), "conditions": [LEAVING]}
    records[1] = records[1]._replace(payload=json.dumps(session).encode())
    place = [record.kind for record in records].index(Kind.SETPOINT)
    records.insert(place + 1, event("CONDITION_ENDED"))
    records.insert(place, event("CONDITION_BEGAN"))

    claims = checked("qp12", records, given, allow=False).claims
    assert claims.false == 0
    assert claims.unverifiable == 1
    assert claims.counts["V"].checked == TICKS - 1


def test_a_reset_before_the_first_state_begins_the_ramp_with_it():
    records, given = recorded("qp12", "hoap3", TICKS)
    (reset,) = (i for i, record in enumerate(records) if record.kind == Kind.EVENT)
    records.insert(2, records.pop(reset))

    part = checked("qp12", records, given, allow=False)
    assert part.unreadable == ""
    assert part.claims.counts["V"].checked == TICKS
    assert (part.claims.false, part.claims.unverifiable) == (0, 0)


def test_code_that_a_change_names_is_imported_on_request_only(tmp_path, monkeypatch):
    (tmp_path / "of_a_log.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "of_a_log", None)  # it is removed after the test
    del sys.modules["of_a_log"]
    records, given = recorded("stable_qp", "hoap3", TICKS)
    constraint = {"constraint": "of_a_log:Constraint", "parameters": {"a": 1}}
    given = {**given, "constraints": [constraint]}
    change = {"constraints": {"0": {"parameters": {"a": 2}}}}
    place = [record.kind for record in records].index(Kind.SETPOINT)
    records.insert(place, Record(Kind.CHANGE, 0, json.dumps(change).encode()))
    check = partial(checked, "stable_qp", records, given)

    part = check(allow=False)
    assert "of_a_log" not in sys.modules
    assert part.claims.unverifiable > 0
    check(allow=True)
    assert "of_a_log" in sys.modules
