"""Settings take numbers for numbers and truths for truths.

Pydantic alone takes `true` for 1, the text "3" for 3, and 1 and the text "yes" for `true`.
"""

from __future__ import annotations

from typing import Any

_NO_SCHEMAS = {"default", "metadata", "config", "cls", "serialization", "expected"}


def make_strict(schema: Any) -> None:
    """Take nothing else for every integer, float and boolean in a schema of pydantic."""
    if isinstance(schema, dict):
        if schema.get("type") in {"int", "float", "bool"}:
            schema["strict"] = True
        for key, inner in schema.items():
            if key not in _NO_SCHEMAS:
                make_strict(inner)
    elif isinstance(schema, list | tuple):
        for inner in schema:
            make_strict(inner)
