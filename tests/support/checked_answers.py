"""What verify finds of a controller's answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import check_engagements


def check_answers(
    records: Iterable[Record], controller: str, parameters: Mapping[str, Any]
) -> Claims:
    """Compare what answers claim with what is recomputed of them."""
    claims = Claims()
    check_engagements(records, controller, parameters, claims)
    return claims
