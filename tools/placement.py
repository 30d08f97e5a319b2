"""Which CPUs a run takes: one for both sides, or one each."""

from __future__ import annotations

from protocol.realtime import CpuClaim, claim_cpu, virtual_machine
from protocol.settings import RealtimeSettings
from tools.awake import may_keep_awake


def waking_is_dear(*sides: RealtimeSettings) -> bool:
    """Whether waking another CPU takes long: on a virtual machine, unless kept awake."""
    return virtual_machine() and not all(_stays_awake(side) for side in sides)


def claim_cpus(robot: RealtimeSettings, controller: RealtimeSettings) -> list[CpuClaim]:
    """The CPUs of a robot and its controller, in this order; a single one is for both.

    The controller has the last CPU, as where it is alone: a robot beside it did better on the one
    before, where fewer interrupts were handled.
    """
    if "auto" not in {robot.cpu, controller.cpu}:
        return []
    wanted = 1 if waking_is_dear(robot, controller) else 2
    claims = [claim for _ in range(wanted) if (claim := claim_cpu()) is not None]
    return claims[::-1]


def _stays_awake(side: RealtimeSettings) -> bool:
    watched = side.policy == "auto" and side.watch_stalls != "none"
    return watched and side.keep_awake and may_keep_awake()
