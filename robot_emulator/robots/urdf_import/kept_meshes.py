"""Whether the meshes beside a `robot.yaml` are those that it names."""

from __future__ import annotations

from pathlib import Path

from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.robots.urdf_import.folder import MESHES
from hoap3.robot_emulator.robots.urdf_import.shapes.mesh_files import MeshError, digest
from hoap3.robot_emulator.robots.yaml_file import RobotFile


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
