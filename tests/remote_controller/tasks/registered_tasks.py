"""Every registered task: ours as `task_cases` has them, those of packages with their defaults."""

from __future__ import annotations

import task_cases

from hoap3.remote_controller.tasks.registry import TaskSettings, find, registered
from hoap3.testing import TaskCase


def velocity_tasks() -> list[str]:
    """Registered tasks that have a V."""
    return [name for name in sorted(registered()) if "velocity" in find(name).levels]


def cases() -> list[TaskCase]:
    """What the property suite runs over."""
    ours = [
        TaskCase(case, robot, TaskSettings(task=name, parameters=parameters), case)
        for case, (robot, name, parameters) in task_cases.CASES.items()
    ]
    known = {case.settings.task for case in ours}
    others = [
        TaskCase(name, task_cases.HOAP3, TaskSettings(task=name), f"task {name}")
        for name in velocity_tasks()
        if name not in known
    ]
    return [*ours, *others]
