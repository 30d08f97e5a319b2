"""Compare two tables, whose rows are found by a key such as the tick."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .difference import Difference
from .json_tree import compare_json, is_number

Table = Mapping[str, Mapping[str, Any]]
"""By key of a row, such as ``tick 12``: the value of each column."""


def compare_tables(old: Table, new: Table, path: str) -> Iterator[Difference]:
    """Yield one difference for missing rows, one for added rows, and one for each column."""
    removed, added = [key for key in old if key not in new], [key for key in new if key not in old]
    if removed:
        yield Difference(
            f"{path}rows", "removed", len(removed), where=removed[0], count=len(removed)
        )
    if added:
        yield Difference(f"{path}rows", "added", None, len(added), where=added[0], count=len(added))
    columns = dict.fromkeys(name for table in (old, new) for row in table.values() for name in row)
    common = [key for key in old if key in new]
    for name in columns:
        if not any(name in row for row in old.values()):
            yield Difference(path + name, "added", new="column")
        elif not any(name in row for row in new.values()):
            yield Difference(path + name, "removed", old="column")
        else:
            yield from _compare_column(old, new, common, name, path + name)


def compare_arrays(old: Path, new: Path, path: str) -> Iterator[Difference]:
    """Yield the differences of two `.npy` or `.npz` files."""
    if old.read_bytes() != new.read_bytes():
        yield from compare_tables(read_arrays(old), read_arrays(new), path)


def read_arrays(path: Path) -> Table:
    """One row with all arrays of a file; a structured array gives one row for each element."""
    content = np.load(path)
    if not isinstance(content, np.ndarray):
        return {"arrays": {name: content[name] for name in content.files}}
    names = content.dtype.names
    return {f"row {i}": {n: np.array(row[n]) for n in names} for i, row in enumerate(content)}


def compare_csv(old: Path, new: Path, path: str) -> Iterator[Difference]:
    """Yield the differences of two CSV files; lines before the header begin with `#`."""
    if old.read_bytes() != new.read_bytes():
        before, after = read_csv(old), read_csv(new)
        yield from compare_json(before[0], after[0], f"{path}comments")
        yield from compare_tables(before[1], after[1], path)


def read_csv(path: Path) -> tuple[list[str], Table]:
    """Lines of comments, and one row for each line below the header."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    table = {f"row {i}": {k: number_of(v) for k, v in row.items()} for i, row in enumerate(rows)}
    return comments, table


def number_of(text: str) -> float | str:
    """A cell as a number where it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _compare_column(
    old: Table, new: Table, keys: list[str], name: str, path: str
) -> Iterator[Difference]:
    worst, count = None, 0
    for key in keys:
        one, other = old[key].get(name), new[key].get(name)
        if not same(one, other):
            count += 1
            found = difference_of(one, other, path, key)
            if worst is None or rank(found) > rank(worst):
                worst = found
    if worst is not None:
        yield replace(worst, count=count)


def rank(difference: Difference) -> float:
    """What is not a number differs more than any number."""
    return np.inf if difference.size is None else difference.size


def same(one: Any, other: Any) -> bool:
    """Whether two values have the same bits."""
    if isinstance(one, np.ndarray | float) and isinstance(other, np.ndarray | float):
        a, b = np.asarray(one), np.asarray(other)
        return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    return type(one) is type(other) and bool(one == other)


def difference_of(one: Any, other: Any, path: str, key: str) -> Difference:
    """The difference of two values; of arrays that of the elements that differ most."""
    if is_number(one) and is_number(other):
        one, other = np.asarray(one), np.asarray(other)
    arrays = isinstance(one, np.ndarray) and isinstance(other, np.ndarray)
    if (
        not arrays
        or one.shape != other.shape
        or not {one.dtype.kind, other.dtype.kind} <= set("biuf")
    ):
        return Difference(path, "changed", one, other, where=key)
    a, b = one.astype(float), other.astype(float)
    equal = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore"):
        sizes = np.where(equal, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf, posinf=np.inf))
    place = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    where = f"{key} {[int(each) for each in place]}" if place else key
    return Difference(
        path, "changed", one[place].item(), other[place].item(), float(sizes[place]), where
    )
