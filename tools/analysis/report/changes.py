"""What each logged change of a controller's parameters changed, from which value to which."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from hoap3.protocol.config.user_code import user_code
from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.problems.history import OF_PRIORITIES
from hoap3.remote_controller.problems.parameters_in_force import ParametersInForce
from hoap3.tools.logs.log import Log

_KINDS = Event.schema.constants
_NOT_FOLLOWED = (Hoap3Error, LookupError, TypeError, ValueError, AttributeError)


def read_changes(log: Log) -> list[str]:
    """Parameters, old and new values of each change of a controller's log, in their order.

    Old values are those in force at the change, also during the transition of an earlier one; a
    transition that the controller delayed counts as not delayed. Of controllers and tasks that are
    not registered here only new values are given, since no code that a log names is imported.
    """
    texts: list[str] = []
    in_force, request = _parameters(log), None
    for record in log.records(Kind.CHANGE, Kind.EVENT):
        if record.kind == Kind.CHANGE:
            request = json.loads(record.payload)
            continue
        kind, tick = Event.scalars(record.payload, "kind", "tick")
        if kind == _KINDS["RESET"] and in_force is not None:
            in_force.reset()
        elif kind == _KINDS["CHANGED"]:
            texts.append("" if request is None else _text(request, tick, in_force))
            request = None
    return texts


def _parameters(log: Log) -> ParametersInForce | None:
    settings = log.settings or {}
    given = settings.get("parameters")
    try:
        with user_code(allowed=False):
            name, parameters = str(settings.get("controller")), given or {}
            return ParametersInForce(name, log.description, parameters)
    except _NOT_FOLLOWED:
        return None


def _text(request: Mapping[str, Any], tick: int, in_force: ParametersInForce | None) -> str:
    values = {key: value for key, value in request.items() if key != "over_s"}
    found = [f"{key}: {_value(value)}" for key, value in values.items()]
    if in_force is not None and OF_PRIORITIES.isdisjoint(values):
        try:
            with user_code(allowed=False):
                in_force.advance(tick, held=False)
                asked = in_force.ask(request)
                in_force.advance(tick + 1, held=False)
            found = [f"{key}: {_value(old)} → {_value(new)}" for key, old, new in asked]
        except _NOT_FOLLOWED:
            pass
    if "over_s" in request:
        found.append(f"over {_value(request['over_s'])} s")
    return ", ".join(found)


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
