"""Which settings may be changed while something runs: a word of the field that has them."""

from __future__ import annotations

from typing import Any

from pydantic.fields import FieldInfo

CHANGEABLE: dict[str, Any] = {"changeable": True}
"""`Field(…, json_schema_extra=CHANGEABLE)` declares that a number may change while it counts."""


def is_changeable(field: FieldInfo) -> bool:
    """Whether a field is declared so."""
    extra = field.json_schema_extra
    return isinstance(extra, dict) and extra.get("changeable") is True
