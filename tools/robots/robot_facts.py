"""What a robot is: joints and limits, what is guessed, what follows, weighs and can collide."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rich.markup import escape
from rich.table import Table

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.urdf import MOVABLE
from hoap3.robot_emulator.robots import find_file, load
from hoap3.robot_emulator.robots.urdf_import.folder import wrong_meshes
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.robot_emulator.robots.urdf_import.notes import Notes
from hoap3.robot_emulator.robots.urdf_import.sanitize import BRAKING, SOFT, count_the_rest
from hoap3.robot_emulator.robots.urdf_import.source import is_source
from hoap3.robot_emulator.robots.yaml_file import RobotFile, read_files
from hoap3.tools.analysis.output import print_line, results


@dataclass(frozen=True)
class Facts:
    """A robot, what its file says of it, what its import found, and how many meshes draw it."""

    description: RobotDescription
    file: RobotFile | None = None
    notes: list[str] = field(default_factory=list)
    meshes: int = 0


def look(
    name: str, package_path: Sequence[Path] = (), *, strict: bool = False, **how: Any
) -> Facts:
    """Read a robot: a vendor's URDF, a folder, a YAML file, or a name.

    Args:
        name: which.
        package_path: where the packages of a URDF are looked for first; of no use to the others.
        strict: a mesh that is missing, or is another than the file says, is an error.
        how: `tip` and `lock_joints` of a URDF, see `import_robot`.

    Raises:
        UsageError: it is none, or something in it is wrong.
    """
    if is_source(name):
        found = import_robot(name, package_path, strict=strict, **how)
        notes = [note.line() for note in found.notes]
        return Facts(found.description, found.file, notes, len(found.parts.visuals))
    if package_path:
        problem = f"is of no use for {name}, whose meshes lie in its own folder"
        remedy = "Leave it out, or name the URDF that the robot was made of"
        raise ConfigError("--package-path", "", str(package_path[0]), problem, remedy)
    description, path = load(name, **how), find_file(name)
    if path is None:
        return Facts(description)
    file, urdf = read_files(path)
    wrong = wrong_meshes(path, file)
    if wrong and strict:
        first, *others = wrong
        raise ConfigError(first.file, first.key, first.value, first.problem, first.remedy, others)
    rest = Notes()
    count_the_rest(ET.fromstring(urdf), rest)  # noqa: S314 - checked before
    for tag in [each for each in (SOFT, BRAKING) if f"<{each}" in urdf]:  # an import reads them
        rest.add("left out", "write the limits into robot.yaml", f"{urdf.count(f'<{tag}')} <{tag}>")
    notes = [*map(str, wrong), *(note.line() for note in rest.all)]
    return Facts(description, file, notes, len(file.meshes))


def as_json(facts: Facts) -> dict[str, Any]:
    """All of it, as `hoap3 robot check --json` prints it; `null` where there is no limit."""
    robot, structure = facts.description, facts.description.structure
    guessed = {each.name: list(each.guessed) for each in (facts.file and facts.file.joints) or ()}
    model = build_model(robot)
    task = robot.default_task
    return {
        "name": robot.name,
        "base_frame": robot.base_frame,
        "command_kinds": list(robot.command_kinds),
        "joints": [
            {
                "name": joint.name,
                "kind": structure.moved[joint.name].kind,
                **{
                    key: _or_null(getattr(joint, key))
                    for key in ("lower", "upper", "velocity", "effort")
                },
                "setpoint_acceleration_max": joint.setpoint_acceleration_max,
                "brake_acceleration": joint.brake_acceleration,
                "setpoint_jerk_max": _or_null(joint.setpoint_jerk_max),
                "guessed": guessed.get(joint.name, []),
            }
            for joint in robot.joints
        ],
        "followers": [
            {
                "name": each.name,
                "follows": each.mimicked,
                "ratio": each.multiplier,
                "offset": each.offset,
            }
            for each in structure.mimic_joints.values()
        ],
        "fixed_joints": sum(joint.kind not in MOVABLE for joint in structure.joints),
        "links": len(structure.links),
        "mass_kg": {"all": model.total_mass, "moving": model.total_mass - model.root_mass},
        "shapes": _shapes(robot),
        "meshes": facts.meshes,
        "initial_posture": {"name": robot.initial_posture, "q": robot.initial_position.tolist()},
        "default_task": None if task is None else task.model_dump(exclude_none=True),
        "notes": facts.notes,
    }


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _shapes(robot: RobotDescription) -> dict[str, dict[str, int]]:
    """By link, how many collision shapes of each kind it has."""
    found = {}
    for link in ET.fromstring(robot.urdf).findall("link"):  # noqa: S314 - checked before
        kinds = Counter(shape.tag for shape in link.iterfind("collision/geometry/*"))
        if kinds:
            found[link.get("name", "")] = dict(kinds)
    return found


def show(found: dict[str, Any]) -> None:
    """Print it for people."""
    n, mass, task = len(found["joints"]), found["mass_kg"], found["default_task"]
    print_line(
        f"{found['name']}: {n} joints, {len(found['followers'])} mimic joints, "
        f"{found['fixed_joints']} fixed; {found['links']} links, root {found['base_frame']!r}; "
        f"{mass['all']:.4g} kg, of which {mass['moving']:.4g} kg move"
    )
    print_line(f"takes: {', '.join(found['command_kinds'])}")
    limits = {
        "lower": "lower",
        "upper": "upper",
        "velocity": "velocity",
        "acceleration": "setpoint_acceleration_max",
        "braking": "brake_acceleration",
        "effort": "effort",
    }
    table = Table("joint", "kind", *limits, "guessed", box=None, pad_edge=False)
    for joint in found["joints"]:
        figures = (joint[key] for key in limits.values())
        shown = ("none" if figure is None else f"{figure:.4g}" for figure in figures)
        table.add_row(escape(joint["name"]), joint["kind"], *shown, ", ".join(joint["guessed"]))
    results.print(table)
    for each in found["followers"]:
        print_line(
            f"{each['name']} follows {each['follows']}: {each['ratio']:g} q + {each['offset']:g}"
        )
    kinds: Counter[str] = Counter()
    for shapes in found["shapes"].values():
        kinds.update(shapes)
    listing = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "none"
    print_line(
        f"shapes: {listing}, on {len(found['shapes'])} links; {found['meshes']} meshes to draw"
    )
    start = found["initial_posture"]
    print_line(
        f"starts in {start['name'] or 'its reference'}: "
        + ", ".join(f"{angle:.4g}" for angle in start["q"])
    )
    print_line("default task: " + (_task(task) if task else "none"))
    for note in found["notes"]:
        print_line(note)


def _task(task: dict[str, Any]) -> str:
    kind = "to" if "target_m" in task else "by"
    x, y, z = task.get("target_m") or task["move_m"]
    return f"{task['point']} {kind} {x:g}, {y:g}, {z:g} m, seen from {task['reference']}"
