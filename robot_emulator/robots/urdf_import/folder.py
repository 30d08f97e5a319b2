"""Folder of an imported robot: `robot.yaml`, the URDF that travels, meshes for drawing.

It is written here, and its meshes are checked against the digests in `robot.yaml`.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.robots.urdf_import.imported import RISE_S, ImportedRobot
from hoap3.robot_emulator.robots.urdf_import.links import Visual
from hoap3.robot_emulator.robots.urdf_import.mesh_files import MeshError, digest, read_whole
from hoap3.robot_emulator.robots.urdf_import.source import split_arguments
from hoap3.robot_emulator.robots.yaml_file import SETPOINT_RATE, Guess, JointEntry, RobotFile

MESHES = "meshes"
FILE = "robot.yaml"
WIDTH = 100
_WRAPPER = textwrap.TextWrapper(
    WIDTH,
    initial_indent="# - ",
    subsequent_indent="#   ",
    break_long_words=False,
    break_on_hyphens=False,
)
WHY: dict[Guess, str] = {
    "range": "the URDF gives no limits, so the joint turns without end",
    "velocity": "the URDF gave none; this one was written into it",
    "acceleration": f"given velocity times {SETPOINT_RATE:g}/s; guessed velocity in {RISE_S:g} s",
}
"""What each kind of guess is based on."""


def write_folder(robot: ImportedRobot, folder: Path) -> list[Path]:
    """Write the files of a robot into a new folder, or an empty one.

    Returns:
        What was written, `robot.yaml` first.

    Raises:
        ConfigError: the folder holds something, or cannot be written.
    """
    meshes = _named(robot.parts.visuals)
    files = {
        FILE: _yaml(robot, meshes).encode(),
        robot.file.urdf: robot.parts.urdf.encode(),
        **{f"{MESHES}/{name}": _content(visual.path) for visual, name in meshes.items()},
        **{
            f"{MESHES}/{each.name}": _content(each.path)
            for visual in meshes
            for each in visual.companions
        },
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            problem, remedy = "is not empty", "Name a new folder with --out"
            raise ConfigError("--out", "", str(folder), problem, remedy)
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
    except OSError as error:
        reason = error.strerror or "cannot be written"
        remedy = "Name a folder that can be written with --out"
        raise ConfigError("--out", "", str(folder), reason, remedy) from error
    return [folder / name for name in files]


def _named(visuals: tuple[Visual, ...]) -> dict[Visual, str]:
    """A file name for each mesh; the same for the same content, never one that leads elsewhere."""
    taken: dict[str, str] = {}
    found = {}
    for visual in visuals:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", visual.path.stem)[:60].lstrip("-") or "mesh"
        suffix = visual.path.suffix.lower()
        name, number = stem + suffix, 2
        while taken.setdefault(name, visual.sha256) != visual.sha256:
            name, number = f"{stem}_{number}{suffix}", number + 1
        found[visual] = name
    return found


def _content(path: Path) -> bytes:
    try:
        return read_whole(path)
    except MeshError as error:
        remedy = "Make it readable, and import again"
        raise ConfigError(str(path), "", None, str(error), remedy) from error


def _yaml(robot: ImportedRobot, meshes: dict[Visual, str]) -> str:
    """The text of robot.yaml, with what was read, guessed and left out in comments."""
    file, source = robot.file, robot.source
    arguments = split_arguments(source.label)[1].items()
    made_of = " ".join((source.path.name, *(f"{key}:={value}" for key, value in arguments)))
    lines = [
        f"# {file.name}, made by `hoap3 robot import` of {_plain(made_of)}",
        f"# (sha256 {source.sha256}).",
        "# Units: rad, N m, s, m. What was guessed is yours to correct, here or in the URDF.",
        "#",
    ]
    for note in robot.notes:
        lines += _WRAPPER.wrap(_plain(note.line()))
    lines += [
        f"name: {_value(file.name)}",
        f"urdf: {_value(file.urdf)}",
        f"base_frame: {_value(robot.description.base_frame)}",
        f"command_kinds: {_value(list(file.command_kinds))}",
        "joints:  # wire order; limits that do not stand here stand in the URDF",
    ]
    joints = file.joints or ()
    guessed = [guess for guess in WHY if any(guess in joint.guessed for joint in joints)]
    lines += [f"  # guessed {guess}: {WHY[guess]}" for guess in guessed]
    for joint in joints:
        lines += _joint(joint)
    if file.default_task is not None:
        task = file.default_task.model_dump(exclude_none=True)
        lines.append("default_task:  # guessed: a small motion of the tool")
        lines += [f"  {key}: {_value(value)}" for key, value in task.items()]
    if meshes:
        lines.append(f"meshes:  # in {MESHES}/, for drawing; controllers get none of it")
    for visual, name in meshes.items():
        lines += _mesh(visual, name)
    return "\n".join(lines) + "\n"


def _joint(joint: JointEntry) -> Iterator[str]:
    yield f"  - name: {_value(joint.name)}"
    others = joint.model_dump(exclude={"name", "guessed", "armature"}, exclude_none=True)
    for key, value in others.items():
        yield f"    {key}: {_value(value)}"
    if joint.guessed:
        yield f"    guessed: {_value(list(joint.guessed))}"


def _mesh(visual: Visual, name: str) -> Iterator[str]:
    yield f"  - link: {_value(visual.link)}"
    yield f"    file: {_value(name)}"
    yield f"    sha256: {_value(visual.sha256)}"
    if (visual.scale != 1.0).any():
        yield f"    scale: {_value(visual.scale.tolist())}"
    for key, values in (("xyz_m", visual.xyz), ("rpy_rad", visual.rpy)):
        if values.any():
            yield f"    {key}: {_value(values.tolist())}"
    if visual.companions:
        yield "    companions:"
    for each in visual.companions:
        yield f"      - {{file: {_value(each.name)}, sha256: {_value(each.sha256)}}}"


def _value(value: object) -> str:
    """As YAML: JSON, but for escapes of 16 bits in pairs; plain words need no quotes."""
    if isinstance(value, str) and re.fullmatch(r"[a-z][a-z0-9_]{2,31}(\.urdf)?", value):
        return value if value not in {"null", "true", "false", "yes", "off"} else json.dumps(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, value))}]"
    text = json.dumps(value, ensure_ascii=False)
    return "".join(each if each.isprintable() else f"\\U{ord(each):08x}" for each in text)


def _plain(text: str) -> str:
    """Text of a stranger that can stand in a comment: in one line, printable."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def wrong_meshes(file: Path, robot: RobotFile) -> list[ConfigError]:
    """What is wrong with the meshes of a robot, an error for each file that is.

    Args:
        file: the robot's YAML file.
        robot: what it says.
    """
    wrong, seen = [], set()
    for number, mesh in enumerate(robot.meshes):
        named = [(f"meshes.{number}", mesh.file, mesh.sha256)]
        named += [
            (f"meshes.{number}.companions.{place}", each.file, each.sha256)
            for place, each in enumerate(mesh.companions)
        ]
        for where, name, expected in named:
            if (name, expected) in seen:  # several links may be drawn with one
                continue
            seen.add((name, expected))
            try:
                found = digest(file.parent / MESHES / name)
            except MeshError as error:
                remedy = f"Put it into {MESHES}/ again, or take it out of {file.name}"
                key, value, problem = "file", name, str(error)
            else:
                if found == expected:
                    continue
                remedy = f"Import again, or if it is meant, write {found}"
                key, value = "sha256", expected
                problem = f"{MESHES}/{name} has another digest"
            wrong.append(ConfigError(str(file), f"{where}.{key}", value, problem, remedy))
    return wrong
