"""Short lockstep runs of `stable_qp`, changed choice by choice."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import load_yaml
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.services.simulate import Simulation, simulate

NAMES = {value: name for name, value in STATUS.items()}
EVENTS = Event.schema.constants


def settings(config: str = "stable_qp_hoap3", **changes: Any) -> dict[str, Any]:
    """A shipped config with other parameters; `target_m` moves its point."""
    content = copy.deepcopy(load_yaml(CONFIGS / f"{config}.yaml"))
    target = changes.pop("target_m", None)
    if target is not None:
        content["parameters"]["task"]["parameters"]["target"]["position_m"] = target
    content["parameters"].update(changes)
    return content


@dataclass(frozen=True)
class Run:
    """What came of it."""

    simulation: Simulation

    @property
    def setpoints(self) -> Any:
        return self.simulation.setpoints

    @property
    def statuses(self) -> Counter[str]:
        return Counter(NAMES[int(each)] for each in self.setpoints["solver_status"])

    @property
    def speeds(self) -> np.ndarray:
        """Of the applied reference, (ticks − 1, n) [rad/s]."""
        return np.diff(self.simulation.states["reference"], axis=0) / 1e-3

    @property
    def began(self) -> Counter[str]:
        """How often each condition began, as the log has it."""
        found: Counter[str] = Counter()
        event = Event()
        for record in self.simulation.records:
            if record.kind == Kind.EVENT:
                event.load(record.payload)
                if event.kind == EVENTS["CONDITION_BEGAN"]:
                    found[self.simulation.controller.conditions[event.detail]] += 1
        return found


def run(content: dict[str, Any] | str, seconds: float = 1.0, **robot: Any) -> Run:
    emulator: Any = {"robot": "hoap3", **robot} if robot else "hoap3"
    found = Run(simulate(emulator, content, seconds))
    for name in found.setpoints.dtype.names:
        assert np.isfinite(found.setpoints[name]).all(), name
    return found
