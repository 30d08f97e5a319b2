"""`hoap3 limits`: Algorithm 4 on a robot, beside the accelerations that its description claims."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.protocol.limits.torque_bounds import Velocities, torque_acceleration_bounds
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.service import describe
from hoap3.tools.analysis.output import results
from hoap3.tools.services.configs import load_emulator_config


def sample(
    robot: str,
    samples: int,
    velocities: Velocities,
    polish: int,
    seed: int,
    report: Callable[[int, int], None],
) -> dict[str, Any]:
    """Bounds of each joint in wire order, and findings: what the description claims too much.

    Raises:
        UsageError: no such robot.
        BadProblemError: limits that cannot be sampled; names the joint.
    """
    description = describe(*load_emulator_config(robot, []))
    found = torque_acceleration_bounds(
        Dynamics(description).robot,  # whose gravity is that of the description
        samples,
        velocities=velocities,
        polish=polish,
        seed=seed,
        report=report,
    )
    rows = [
        {
            "joint": joint.name,
            "lower": float(found.lower[place]),
            "upper": float(found.upper[place]),
            "either_way": float(found.either_way[place]),
            "brake_acceleration": joint.brake_acceleration,
            "setpoint_acceleration_max": joint.setpoint_acceleration_max,
        }
        for place, joint in enumerate(description.joints)
    ]
    return {
        "robot": description.name,
        "samples": found.samples,
        "velocities": velocities,
        "polish": polish,
        "seed": seed,
        "joints": rows,
        "findings": [finding for row in rows for finding in _findings(row, found.none)],
    }


def _findings(row: dict[str, Any], none: tuple[str, ...]) -> list[str]:
    """What a user should know of a joint."""
    name = row["joint"]
    if name in none:
        return [f"{name}: in some state it cannot even hold its load"]
    claimed, always = row["brake_acceleration"], row["either_way"]
    if claimed > always:
        return [f"{name}: brake_acceleration is {claimed:g}, and it always has {always:.4g} only"]
    return []


def show(found: dict[str, Any]) -> None:
    """Print a row a joint on standard output, and the findings below."""
    title = f"{found['robot']}: accelerations [rad/s² or m/s²] that torques leave in every state"
    table = Table(title=escape(title), box=None)
    for name in ("joint", "lower", "upper", "either way", "brake_acceleration"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for row in found["joints"]:
        figures = (row["lower"], row["upper"], row["either_way"], row["brake_acceleration"])
        table.add_row(row["joint"], *(f"{figure:.4g}" for figure in figures))
    results.print(table)
    tried = f"{found['samples']:,} states, velocities: {found['velocities']}"
    results.print(f"{tried}, seed {found['seed']}.", style="dim")
    for finding in found["findings"]:
        results.print(finding, markup=False)
