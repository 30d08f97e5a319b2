"""A log says which versions of everything that decides an answer it was made with."""

from __future__ import annotations

import pytest

from hoap3.tools.machine.machine import versions


@pytest.mark.parametrize("package", ["numpy", "numba", "pin", "coal", "daqp", "osqp"])
def test_what_computes_answers_is_named_with_its_version(package):
    assert versions()[package][0].isdecimal()


def test_what_is_not_installed_is_said_to_be_missing(monkeypatch):
    monkeypatch.setattr("hoap3.tools.machine.machine.STACK", ("no-such-package",))
    assert versions()["no-such-package"] == "not installed"
