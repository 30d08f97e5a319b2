"""Which checker knows a controller's claims.

A checker is a function `check(run, parameters, claims)`:

    run: a `ControllerRun`; its tables have one row for each cycle.
    parameters: the controller's, as the log's configuration gives them; the rest has its default.
    claims: takes what was compared.

It recomputes from `run.states`, `run.description` and `parameters` alone what `run.answers` claim.
It uses plain numpy, scipy and Pinocchio, and the modules called `*reference` of the project; no
kernel, and no solver of ours. What it cannot recompute it counts with `claims.unverified`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun

Checker = Callable[[ControllerRun, Mapping[str, Any], Claims], None]

FUNCTIONS = {
    "hqp": "acceleration.hqp:check",
    "joint_acceleration": "acceleration.joint_acceleration:check",
    "tsid": "acceleration.tsid:check",
    "weighted": "acceleration.weighted:check",
}
"""Module and function in `controllers`, by the controller's registered name; other logs, and those
of a free base, have a builder in `statements`."""


def checker_of(controller: str) -> Checker | None:
    """The checker of a controller, or None where nobody here knows what it claims."""
    if controller not in FUNCTIONS:
        return None
    module, function = FUNCTIONS[controller].split(":")
    found: Checker = getattr(import_module(f"hoap3.tools.verify.controllers.{module}"), function)
    return found
