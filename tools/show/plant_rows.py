"""What a simulated body says of itself at the end of a run, for people."""

from __future__ import annotations

from typing import Any

from hoap3.tools.show.body_findings import base_words


def plant_rows(
    plant: dict[str, Any] | None, base: dict[str, Any] | None = None
) -> list[tuple[str, str]]:
    """Name and words of each row, as far as the figures of a plant and a free base are known."""
    plant = plant or {}
    rows = [("base", base_words(base))] if base else []
    if plant.get("com_m") is not None:
        com, by_model = _millimetres(plant["com_m"]), _millimetres(plant["com_by_model_m"])
        zmp = _millimetres(plant["zmp_m"]) if plant.get("zmp_m") else "none"
        text = f"CoM {com}, by the model {by_model}; ZMP {zmp} mm, seen from {plant['frame']}"
        rows.append(("plant", text))
    elif plant.get("com_world_m") is not None:
        rows.append(("plant", f"CoM {_millimetres(plant['com_world_m'])} mm in the world"))
    off = plant.get("periods_off_the_ground") or {}
    tilts = plant.get("largest_tilt_deg") or {}
    if tilts:
        each = [
            f"{sole} tilted by {tilt:.2f}° at most"
            + (f", off the ground in {off[sole]} periods" if sole in off else "")
            for sole, tilt in tilts.items()
        ]
        rows.append(("soles", "; ".join(each)))
    if plant.get("warnings"):
        counts = (f"{name} {count}" for name, count in plant["warnings"].items())
        rows.append(("plant warns", ", ".join(counts)))
    return rows


def _millimetres(place: list[float]) -> str:
    return "(" + ", ".join(f"{1e3 * value:.2f}" for value in place) + ")"
