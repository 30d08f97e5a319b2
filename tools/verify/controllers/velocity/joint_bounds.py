"""Which joint velocities the controllers of several tasks allow in each cycle.

A joint's velocity may change by A·T in a period, may not exceed the greatest speed ω, and must let
the joint come to rest before the end of its range, in steps of A·T.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.velocity import limits_of, velocity_bounds
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]


def bounds_of(run: ControllerRun, given: Mapping[str, Any]) -> Bounds:
    """Least and greatest velocity of each joint for each answer, both (N, n) [rad/s or m/s].

    Args:
        run: whose reference decides, and how it moved since the State before.
        given: `bounds` of the config.
    """
    T, limits = run.description.period_s, limits_of(run.description, given)
    reference = run.answered_states["reference"]
    return velocity_bounds(reference, reference_rates(run), limits, T)


def reference_rates(run: ControllerRun) -> Array:
    """How the reference of each answer's State moved since the State before, (N, n) [rad/s].

    At the first State after a reset it is what the robot measured.
    """
    states, T = run.states, run.description.period_s
    finite = RowsAt.of(states).finite("q", "reference")
    places = np.arange(len(states))
    last = np.maximum.accumulate(np.where(finite, places, -1))
    before = np.append(-1, last[:-1])[run.answered]
    resets = np.array([-1, *run.resets])
    begun = resets[np.searchsorted(resets, run.answered, "right") - 1]
    periods = (states["tick"] - states["skipped"]).astype(np.int64)
    apart = periods[run.answered] - periods[before]
    known = (before >= np.maximum(begun, 0)) & (apart > 0)
    moved = states["reference"][run.answered] - states["reference"][before]
    rates = moved / (np.where(known, apart, 1) * T)[:, None]
    measured = np.nan_to_num(states["dq"][run.answered], posinf=0.0, neginf=0.0)
    return np.asarray(np.where(known[:, None], rates, measured))
