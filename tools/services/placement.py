"""Which CPUs both sides take: one for both, or one each, whichever was better on this machine.

The first run after a boot measures both placements and stores the finding; later ones read it.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.runtime.notes import Detail
from hoap3.protocol.runtime.private_directory import runtime_directory
from hoap3.protocol.runtime.realtime import CpuClaim, claim_cpu, claim_cpus
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.services.placement_probe import measure_placement

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_LARGEST = 64_000  # bytes of a stored finding

Report = Callable[[str], None]


def chosen(report: Report) -> str:
    """Return "one_cpu" or "two_cpus": the stored finding of this boot, or a new measurement.

    Where it cannot be measured, one CPU: it needs no second one to be free, nor to be woken.

    Args:
        report: takes what was found, in words.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return "one_cpu"
    found = _stored()
    if found is None:
        report("placement: measuring one CPU and two, once per boot: some three seconds")
        found = measure_placement()
        remember(found)
    choice: str = found.get("recommended", "one_cpu")
    words = {"one_cpu": "one CPU for both sides", "two_cpus": "one CPU for each side"}
    report(Detail(f"placement: {words[choice]} ({found['why']})"))
    return choice


def remember(found: dict[str, Any]) -> None:
    """Store a finding until the next boot, unless it says nothing of one of the placements."""
    directory = runtime_directory()
    if directory is None or "two_cpus" not in found:
        return
    kept = {"boot": _boot(), "allowed": sorted(os.sched_getaffinity(0)), "found": found}
    with (
        contextlib.suppress(OSError),  # it is measured again next time
        whole_file(directory / "placement.json") as draft,
    ):
        draft.write_text(json.dumps(kept), encoding="utf-8")


def _stored() -> dict[str, Any] | None:
    """What was found on these CPUs since the machine was started, or None."""
    directory = runtime_directory()
    if directory is None:
        return None
    try:
        with (directory / "placement.json").open("rb") as stream:
            kept = json.loads(stream.read(_LARGEST))
        now = {"boot": _boot(), "allowed": sorted(os.sched_getaffinity(0))}
        if not now.items() <= kept.items():
            return None
        found: dict[str, Any] = kept["found"]
        known = found["recommended"] in {"one_cpu", "two_cpus"} and isinstance(found["why"], str)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None  # none yet, or not ours: it is measured again
    return found if known else None


def _boot() -> str:
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def placed(
    robot: RealtimeSettings, controller: RealtimeSettings, report: Report
) -> tuple[RealtimeSettings, RealtimeSettings, list[CpuClaim]]:
    """Both sides with the CPUs that `auto` gets, and the claims that hold these.

    The controller has the last CPU, as where it is alone: a robot beside it did better on the one
    before, where fewer interrupts were handled. A side that names its CPU has it, and the other
    shares it or takes another, as measured. Where none is left, `auto` stays: the service itself
    says so.

    Args:
        robot, controller: settings of both sides.
        report: takes what was found about placements, in words.
    """
    sides = (controller, robot)
    autos = sum(side.cpu == "auto" for side in sides)
    named = [side.cpu for side in sides if isinstance(side.cpu, int)]
    if not autos:
        return robot, controller, []
    together = autos + len(named) == 2 and chosen(report) == "one_cpu"
    claims: list[CpuClaim] = []
    if not (together and named):
        allowed = os.sched_getaffinity(0) - set(named)
        wanted = 1 if together else autos
        claims = claim_cpus(wanted, allowed)
    cpus = [claim.cpu for claim in claims] or (named if together else [])
    return _pinned(robot, cpus[-1:]), _pinned(controller, cpus[:1]), claims


def settled_alone(
    settings: RealtimeSettings, side: str, report: Report
) -> tuple[RealtimeSettings, CpuClaim | None]:
    """A service's settings with the CPU that `auto` gets, and the claim that holds it.

    On one CPU for both, robot and controller claim a side each of the highest one where theirs is
    free. Otherwise a robot leaves the last CPU to its controller.

    Args:
        settings: of the service.
        side: "robot" or "controller".
        report: takes what was found about placements, in words.
    """
    if settings.cpu != "auto":
        return settings, None
    if chosen(report) == "one_cpu":
        claim = claim_cpu(sides=(side,))
    else:
        claim = claim_cpu(leave=1 if side == "robot" else 0)
    return _pinned(settings, [claim.cpu] if claim else []), claim


def _pinned(side: RealtimeSettings, cpu: list[int]) -> RealtimeSettings:
    return side.model_copy(update={"cpu": cpu[0]}) if side.cpu == "auto" and cpu else side
