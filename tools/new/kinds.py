"""What `hoap3 new` can begin: for each kind its files, its entry point, and what runs it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

COMMON = {"pyproject.toml": "pyproject.toml", "README.md": "README.md"}
MODULE = 'py-modules = ["$name"]'
PACKAGE = """packages = ["$name"]
package-data = { $name = ["*.yaml", "*.urdf"] }"""


@dataclass(frozen=True)
class Kind:
    """One of them; `$name` and `$Class` stand for the user's words.

    Attributes:
        what: what it is called, in a line.
        files: paths in the new folder, and the template of each.
        entry: what its entry point names.
        source: the file that people change first.
        run: options of `hoap3 run --lockstep` that make it run.
        taken: names that there are already.
        ending: of the class, where the name does not have it.
        modules: what setuptools is told of the sources.
    """

    what: str
    files: dict[str, str]
    entry: str
    source: str
    run: str
    taken: Callable[[], Iterable[str]]
    ending: str = ""
    modules: str = MODULE


def _controllers() -> Iterable[str]:
    from hoap3.remote_controller.config import available_configs
    from hoap3.remote_controller.registry import registered

    return {*available_configs(), *registered()}


def _tasks() -> Iterable[str]:
    from hoap3.remote_controller.tasks.registry import registered

    return registered()


def _constraints() -> Iterable[str]:
    from hoap3.remote_controller.constraints.registry import registered

    return registered()


def _plants() -> Iterable[str]:
    from hoap3.robot_emulator.plants.registry import registered

    return registered()


def _robots() -> Iterable[str]:
    from hoap3.robot_emulator.config import available_configs
    from hoap3.robot_emulator.robots import available

    return {*available_configs(), *available()}


def _class(kind: str, what: str, run: str, taken: Callable[[], Iterable[str]], ending: str) -> Kind:
    """A kind that is one class in one module, with a config."""
    files = {
        **COMMON,
        "src/$name.py": f"{kind}.py",
        "$name.yaml": f"{kind}.yaml",
        "tests/test_$name.py": f"{kind}_test.py",
    }
    return Kind(what, files, "$name:$Class", "src/$name.py", run, taken, ending)


KINDS = {
    "controller": _class(
        "controller",
        "A controller that brings all joints to a posture, with its problem for hoap3 verify",
        "--controller $name.yaml",
        _controllers,
        "Controller",
    ),
    "task": _class(
        "task",
        "A task that has a frame keep a distance that swings",
        "--robot ur5 --controller $name.yaml",
        _tasks,
        "",
    ),
    "constraint": _class(
        "constraint",
        "A constraint that keeps the centre of mass above a height",
        "--controller $name.yaml",
        _constraints,
        "",
    ),
    "robot": Kind(
        "An arm of three joints",
        {
            **COMMON,
            "src/$name/__init__.py": "robot_init.py",
            "src/$name/robot.yaml": "robot.yaml",
            "src/$name/$name.urdf": "robot.urdf",
            "$name.yaml": "robot_emulator.yaml",
            "tests/test_$name.py": "robot_test.py",
        },
        "$name:FOLDER",
        "src/$name/robot.yaml",
        "--robot $name.yaml",
        _robots,
        modules=PACKAGE,
    ),
    "plant": _class(
        "plant",
        "A plant whose joints hang on springs",
        "--robot $name.yaml",
        _plants,
        "",
    ),
}
