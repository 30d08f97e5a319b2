"""Dotted keys such as `plant.parameters.kp.elbow`; a part with a dot in it stands in quotes."""

from __future__ import annotations

import csv
from collections.abc import Iterable


def split_key(key: str) -> list[str]:
    """Return the parts of a dotted key; of one with wrong quotes, itself."""
    try:
        return next(csv.reader([key], delimiter=".", strict=True)) or [key]
    except csv.Error:
        return [key]


def join_key(parts: Iterable[str]) -> str:
    """Return a dotted key that `split_key` splits into these parts."""
    return ".".join(
        '"' + part.replace('"', '""') + '"' if {*'."='} & {*part} else part for part in parts
    )
