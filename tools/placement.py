"""Which CPUs a run takes: one for both sides, or one each."""

from __future__ import annotations

import os

from protocol.realtime import CpuClaim, claim_cpu, virtual_machine
from protocol.settings import RealtimeSettings
from tools.awake import may_keep_awake


def waking_is_dear(*sides: RealtimeSettings) -> bool:
    """Whether waking another CPU takes long: on a virtual machine, unless kept awake."""
    return virtual_machine() and not all(_stays_awake(side) for side in sides)


def placed(
    robot: RealtimeSettings, controller: RealtimeSettings
) -> tuple[RealtimeSettings, RealtimeSettings, list[CpuClaim]]:
    """Both sides with the CPUs that `auto` gets, and the claims that hold these.

    The controller has the last CPU, as where it is alone: a robot beside it did better on the one
    before, where fewer interrupts were handled. A side that names its CPU has it, and the other
    takes another. Where none is left, `auto` stays: the service itself says so.
    """
    sides = (controller, robot)
    named = [side.cpu for side in sides if isinstance(side.cpu, int)]
    together = waking_is_dear(robot, controller)
    claims: list[CpuClaim] = []
    if not (together and named):
        allowed = os.sched_getaffinity(0) - set(named)
        autos = sum(side.cpu == "auto" for side in sides)
        wanted = min(autos, 1) if together else autos
        claims = [claim for _ in range(wanted) if (claim := claim_cpu(allowed)) is not None]
    cpus = [claim.cpu for claim in claims] or (named if together else [])
    return _pinned(robot, cpus[-1:]), _pinned(controller, cpus[:1]), claims


def _pinned(side: RealtimeSettings, cpu: list[int]) -> RealtimeSettings:
    return side.model_copy(update={"cpu": cpu[0]}) if side.cpu == "auto" and cpu else side


def _stays_awake(side: RealtimeSettings) -> bool:
    watched = side.policy == "auto" and side.watch_stalls != "none"
    return watched and side.keep_awake and may_keep_awake()
