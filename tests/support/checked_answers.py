"""What verify finds of a controller's answers, however it checks them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.verify.changes import with_numbers
from hoap3.tools.verify.checkers import checker_of
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs
from hoap3.tools.verify.controllers.leaving import check_leaving
from hoap3.tools.verify.statements import builder_of, check_engagements


def check_answers(
    records: Iterable[Record], controller: str, parameters: Mapping[str, Any]
) -> Claims:
    """Compare what answers claim with what is recomputed of them."""
    claims, kept = Claims(), list(records)
    if builder_of(controller, parameters) is not None:
        check_engagements(kept, controller, parameters, claims)
        return claims
    check = checker_of(controller)
    assert check is not None
    for run in runs(kept):
        for part, given in with_numbers(run, controller, parameters):
            check(check_leaving(part, given, claims), given, claims)
    return claims
