"""What a robot measured of its body that no controller can know: stops passed, a base that fell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hoap3.robot_emulator.body_watch import FALLEN_DEG

BEYOND, FALLEN = "beyond_stops", "fallen"
BODY_REASONS = {
    BEYOND: "a joint was measured beyond its stops",
    FALLEN: f"the base tilted by more than {FALLEN_DEG:g} degrees",
}
"""Why limits and balance are bad, in words."""

_FIGURES: dict[str, dict[str, type | tuple[type, ...]]] = {
    "beyond_stops": {
        "periods": int,
        "first": str,
        "first_tick": int,
        "furthest": str,
        "furthest_by": (int, float),
        "unit": str,
    },
    "held_back_joints": {"first": str, "first_tick": int, "most": str, "most_periods": int},
    "held_back_limit": {"limit": str, "value": (int, float), "unit": str},
    "base": {
        "tilt_deg": (int, float),
        "largest_tilt_deg": (int, float),
        "fallen_tick": (int, type(None)),
        "moved_m": list,
    },
}


def body_of(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return each of `_FIGURES` of a robot's summary; None where it is not complete.

    Args:
        summary: as a robot of any version wrote it; docs/start/concepts.md has the keys.
    """
    return {
        name: dict(summary[name]) if _whole(summary.get(name), figures) else None
        for name, figures in _FIGURES.items()
    }


def body_reasons(body: Mapping[str, Any]) -> list[str]:
    """Which of the two is bad."""
    base = body.get("base")
    reasons = [BEYOND] if body.get("beyond_stops") else []
    return [*reasons, FALLEN] if base and base["largest_tilt_deg"] > FALLEN_DEG else reasons


def body_words(body: Mapping[str, Any]) -> list[str]:
    """How far joints were beyond their stops, and how a base that fell did."""
    words, beyond, base = [], body.get("beyond_stops"), body.get("base")
    if beyond:
        words.append(
            f"{beyond['furthest']} by {beyond['furthest_by']:.3g} {beyond['unit']} beyond its "
            f"stops; first {beyond['first']} at tick {beyond['first_tick']}, some joint in "
            f"{beyond['periods']} periods"
        )
    if base and FALLEN in body_reasons(body):
        tilt = f"tilted by {base['largest_tilt_deg']:.3g} degrees"
        words.append(f"fallen at tick {base['fallen_tick']}: {tilt}")
    return words


def base_words(base: Mapping[str, Any]) -> str:
    """How far a free base tilted and moved."""
    x, y, z = base["moved_m"]
    return (
        f"tilted by {base['largest_tilt_deg']:.3g} degrees at most, "
        f"{base['tilt_deg']:.3g} at the end; moved by ({x:.3g}, {y:.3g}, {z:.3g}) m"
    )


def _whole(found: Any, figures: Mapping[str, type | tuple[type, ...]]) -> bool:
    """Whether a robot's word has all figures, and finite ones."""
    if not isinstance(found, dict):
        return False
    if not all(isinstance(found.get(key), kind) for key, kind in figures.items()):
        return False
    moved = found.get("moved_m", [0.0, 0.0, 0.0])
    numbers = [*moved, *(value for value in found.values() if isinstance(value, float))]
    finite = all(isinstance(each, int | float) and math.isfinite(each) for each in numbers)
    return finite and len(moved) == 3
