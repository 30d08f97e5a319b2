"""How all controllers of several tasks are checked; each says what its problem is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    complete,
    reason_of,
)
from hoap3.remote_controller.problems.schedule import Schedule
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.answers import NOT_REMEMBERED, check_refused
from hoap3.tools.verify.controllers.acceleration.certificate import (
    Solution,
    check_bounds,
    check_columns,
    check_lyapunov,
    check_proof,
)
from hoap3.tools.verify.controllers.acceleration.fallbacks import Soft, check_fallback
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Settings = Mapping[str, Any]

OF_FREE_BASES = {"base", "contacts"}
"""Keys that say nothing of a base that stands."""


class Family(ABC):
    """One controller: its tasks, how they are weighed up, and the problem that is solved."""

    defaults: ClassVar[Settings]
    proves: ClassVar[bool]

    def entries(self, run: ControllerRun, settings: Settings) -> list[Settings]:
        """The tasks, as a config has them."""
        del run
        return list(settings["tasks"])

    @abstractmethod
    def schedule(self, names: list[str], settings: Settings) -> Schedule:
        """Weights or priorities, as they begin."""

    @abstractmethod
    def tops(self, numbers: Array) -> Flags:
        """Which tasks V is of, (N, k), by their weights or priorities."""

    @abstractmethod
    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """Whether the answers are the optimum."""

    @abstractmethod
    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """What stands in for the optimum in each of some cycles."""


def check_family(family: Family, run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that is claimed of a controller's answers."""
    parameters = {key: value for key, value in parameters.items() if key not in OF_FREE_BASES}
    try:
        settings = complete(parameters, family.defaults, "parameters", strict=False)
        bounds.check_settings(settings["bounds"], run.description.n)
        _check_robot(run)
        hierarchy, begin, names = _built(family, run, settings)
    except NOT_READ as error:
        claims.unverified("certificate", len(run.answers), reason_of(error))
        return
    states = run.answered_states
    finite = states.finite("q", "dq", *(["wrench"] if hierarchy.presses else []))
    claims.unverified("certificate", int((~run.remembered).sum()), NOT_REMEMBERED)
    check_refused(run.only(run.remembered & ~finite), claims)
    run = run.only(run.remembered & finite)
    lost = ~run.answers.finite("values")
    claims.unverified("certificate", int(lost.sum()), "the answer is not finite")
    constraints = {str(each.get("constraint"))[:60] for each in settings["constraints"] or ()}
    for part, cycles in hierarchy.cycles(run.only(~lost), begin):
        tops = family.tops(cycles.numbers)
        check_lyapunov(part, cycles, hierarchy, tops, claims)
        check_columns(part, cycles, hierarchy, names, claims)
        for kind in constraints:
            reason = f"constraint {kind} of accelerations is not recomputed"
            claims.unverified("bounds and optimum", len(tops), reason)
        if constraints:
            continue
        check_bounds(part, cycles, hierarchy, claims)
        solution = family.solution(cycles, hierarchy, settings)
        check_proof(part, cycles, hierarchy, solution, tops, claims)
        instead = part.answers["fallback"] != 0
        soft = family.soft(cycles.part(instead), hierarchy, settings) if instead.any() else []
        places = np.flatnonzero(instead).tolist()
        check_fallback(part, cycles, hierarchy, dict(zip(places, soft, strict=True)), claims)


def _check_robot(run: ControllerRun) -> None:
    """Raise an UnverifiableError where answers to the robot cannot be verified at all."""
    if not {"torque", "acceleration"} & {*run.description.command_kinds}:
        raise UnverifiableError("the robot takes neither torques nor accelerations")
    if run.description.delay_ticks:
        raise UnverifiableError("answers are delayed, and this controller takes no delay")


def _built(
    family: Family, run: ControllerRun, settings: Settings
) -> tuple[Hierarchy, Any, list[str]]:
    entries = family.entries(run, settings)
    names = labels_of(entries)
    kinds = run.description.command_kinds
    torques = next(kind for kind in kinds if kind != "position") == "torque"
    hierarchy = Hierarchy(
        run.description, entries, settings, torques=torques, messages=run.messages
    )
    family.schedule(names, settings)  # which must be readable
    return hierarchy, lambda: family.schedule(names, settings), names


def braking(cycles: Cycles, settings: Settings, hierarchy: Hierarchy) -> Array:
    """−d·q̇, what motion that no task speaks of brakes by, (N, n); d at most 1/T."""
    d = min(settings["null_damping_per_s"], 1.0 / hierarchy.description.period_s)
    return np.asarray(-d * cycles.dq)


def labels_of(entries: Sequence[Settings]) -> list[str]:
    """Names of the tasks."""
    return [str(entry.get("name") or entry.get("task") or entry["kind"]) for entry in entries]
