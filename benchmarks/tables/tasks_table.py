"""Write the table of tasks in docs/guides/extending.md."""

from __future__ import annotations

from pathlib import Path

from benchmarks.tables.pairs_table import with_table
from hoap3.remote_controller import registry as controllers
from hoap3.remote_controller.controllers.base import VelocityController
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.remote_controller.tasks.error_task import ErrorTask
from hoap3.remote_controller.tasks.lyapunov import Level, LyapunovFunction

BEGIN = "<!-- tasks: written by `python -m benchmarks.tables.tasks_table` -->\n"
END = "<!-- end of tasks -->\n"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "extending.md"
OWN_ERROR, OWN_V = "your own error", "your own V, without an error"


def takes(controller: str) -> str:
    """The key under which a controller takes tasks of any kind: `tasks`, `task`, or "" for none."""
    fields = controllers.find(controller).Parameters.model_fields
    if "tasks" in fields:
        return "tasks"
    given = fields.get("task")
    return "task" if given is not None and tasks.TaskSettings in _types(given.annotation) else ""


def level(controller: str) -> Level:
    """What it asks the robot for."""
    velocity = issubclass(controllers.find(controller), VelocityController)
    return "velocity" if velocity else "acceleration"


def of_tasks() -> list[str]:
    """Our controllers that take tasks of any kind: those of velocities first."""
    known = [name for name in controllers.BUILTIN if takes(name)]
    return sorted(known, key=level, reverse=True)


def serves(controller: str, task: str) -> bool:
    """Whether a controller takes a task, ours by its name, or `OWN_ERROR` or `OWN_V`."""
    if task == OWN_V:
        return takes(controller) == "task" and level(controller) in LyapunovFunction.levels
    found = ErrorTask if task == OWN_ERROR else tasks.find(task)
    return level(controller) in found.levels


def table() -> str:
    """Markdown: a row for each task, a column for each controller."""
    columns = of_tasks()
    lines = [
        "| task | " + " | ".join(f"`{controller}`" for controller in columns) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    for task in [*tasks.BUILTIN, OWN_ERROR, OWN_V]:
        cells = ["yes" if serves(controller, task) else "" for controller in columns]
        name = f"`{task}`" if task in tasks.BUILTIN else task
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def written(page: str) -> str:
    """The page with the table as it is now.

    Raises:
        ValueError: the page has no place for it.
    """
    return with_table(page, BEGIN, table(), END)


def _types(annotation: object) -> tuple[object, ...]:
    """The types of a union, or the one that it is."""
    return getattr(annotation, "__args__", (annotation,))


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
