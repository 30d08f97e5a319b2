"""Which files of tests begin: those that a worker would still be at when the others have done."""

from __future__ import annotations

FIRST = (
    "tests/remote_controller/controllers/test_controller_properties.py",
    "tests/docs/test_docs.py",
    "tests/system/",
)


def place(test: str) -> int:
    """Where a test belongs, by its name as pytest has it: those of `FIRST`, then all others."""
    fitting = (number for number, start in enumerate(FIRST) if test.startswith(start))
    return next(fitting, len(FIRST))
