"""Changes of a controller's parameters are listed with their old and new values."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.log_samples import MS, START, describe, fill, write

from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.report.events import read_events
from hoap3.tools.logs.log import Log

KINDS = Event.schema.constants


def log_of(folder, changes, controller="qp12", parameters=None, resets=(0,)) -> Log:
    """Log of a controller of 1000 ticks, to which requests came after some of them."""
    description, rng = describe(2), np.random.default_rng(0)
    session = {"side": "controller", "session_id": 7}
    records = [
        Record(Kind.DESCRIPTION, START - 2, description.to_json()),
        Record(Kind.SESSION, START - 1, json.dumps(session).encode()),
    ]

    def note(kind, tick):
        event = Event()
        event.kind, event.session_id, event.tick, event.detail = KINDS[kind], 7, tick, tick
        event.stamp = START + tick * MS
        records.append(Record(Kind.EVENT, event.stamp, event.dump()))

    for tick in range(1000):
        at = START + tick * MS
        given = {"session_id": 7, "tick": tick, "mode": State.ACTIVE, "stamp_intended": at}
        records.append(Record(Kind.STATE, at, fill(State(2), rng, **given)))
        if tick in resets:
            note("RESET", tick)
        for request in changes.get(tick, ()):
            records.append(Record(Kind.CHANGE, at, json.dumps(request).encode()))
            note("CHANGED", tick)
    config = {"controller": controller, "parameters": parameters or {}}
    attachments = {
        "description.json": description.to_json(),
        "config.yaml": json.dumps(config).encode(),
    }
    write(folder / "controller.mcap", records, side="controller", attachments=attachments)
    return Log.open(folder)


def changes_in(log: Log) -> list[str]:
    return [event.detail for event in read_events(log) if event.name == "changed"]


def test_each_change_has_its_parameters_with_old_and_new_values(tmp_path):
    changes = {
        100: [{"gamma": 2.0, "over_s": 0.2}],
        200: [{"gamma": 4.0, "over_s": 0}],  # half way, which 0.5 − 0.5 cos πt is, too
        600: [{"gamma": 0.5}],
        900: [{"gamma": 3.0}],  # after a reset
    }
    parameters = {"gamma": 1.0, "target_m": [0.01, 0.02, 0.3]}
    log = log_of(tmp_path, changes, parameters=parameters, resets=(0, 800))
    first, second, third, fourth = changes_in(log)
    assert first == "gamma: 1 → 2, over 0.2 s"
    name, before, _, after, *_ = second.split()
    assert (name, after) == ("gamma:", "4,")
    assert float(before) == pytest.approx(1.5, abs=0.01)
    assert third == "gamma: 4 → 0.5"
    assert fourth == "gamma: 1 → 3"


def test_of_code_that_is_not_imported_new_values_alone_are_known(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "a_module.py").write_text("raise AssertionError('was imported')")
    log = log_of(tmp_path, {5: [{"pace": 2}]}, controller="a_module:Mine")
    assert changes_in(log) == ["pace: 2"]


def test_of_priorities_the_request_is_listed(tmp_path):
    (text,) = changes_in(log_of(tmp_path, {5: [{"order": ["hand", "posture"], "over_s": 1}]}))
    assert text == 'order: ["hand", "posture"], over 1 s'
