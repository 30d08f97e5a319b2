"""Control a robot from a separate process, 1,000 times a second, and see why a deadline was missed.

    import hoap3

    run = hoap3.simulate(robot="hoap3", controller="qp12", duration=5.0)

Importing this package loads neither numba nor Pinocchio, Zenoh or matplotlib: what needs them is
loaded when its name is first used. The rooms of the repository stand in it as subpackages.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from hoap3.protocol import __version__
from hoap3.protocol.errors import (
    AuthorityError,
    BadProblemError,
    ConfigError,
    DescriptionError,
    FrameNotFoundError,
    Hoap3Error,
    InfeasibleError,
    LinkError,
    LogError,
    NameTakenError,
    NoDefaultTaskError,
    NotInstalledError,
    PortInUseError,
    SolverError,
    UnknownNameError,
    UsageError,
    WireError,
)

if TYPE_CHECKING:
    from hoap3.protocol.robot.description import RobotDescription
    from hoap3.protocol.config.settings import Settings
    from hoap3.remote_controller import bounds, solvers
    from hoap3.remote_controller.constraints.constraint import Constraint
    from hoap3.remote_controller.controllers.base import Controller, VelocityController
    from hoap3.remote_controller.tasks.error_task import ErrorTask
    from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
    from hoap3.remote_controller.tasks.task import Task
    from hoap3.robot_emulator.robots import load as load_robot
    from hoap3.tools.environment.environment import Environment
    from hoap3.tools.services.connection import Connection, connect
    from hoap3.tools.services.simulate import simulate

__all__ = [  # not Environment, which needs an extra: `from hoap3 import *` works without it
    "AuthorityError",
    "BadProblemError",
    "ConfigError",
    "Connection",
    "Constraint",
    "Controller",
    "DescriptionError",
    "ErrorTask",
    "FrameNotFoundError",
    "Hoap3Error",
    "InfeasibleError",
    "LinkError",
    "LogError",
    "LyapunovFunction",
    "NameTakenError",
    "NoDefaultTaskError",
    "NotInstalledError",
    "PortInUseError",
    "RobotDescription",
    "Settings",
    "SolverError",
    "Task",
    "UnknownNameError",
    "UsageError",
    "VelocityController",
    "WireError",
    "__version__",
    "bounds",
    "connect",
    "load_robot",
    "simulate",
    "solvers",
]

_LAZY = {
    "Connection": "hoap3.tools.services.connection:Connection",
    "Constraint": "hoap3.remote_controller.constraints.constraint:Constraint",
    "Controller": "hoap3.remote_controller.controllers.base:Controller",
    "Environment": "hoap3.tools.environment.environment:Environment",
    "ErrorTask": "hoap3.remote_controller.tasks.error_task:ErrorTask",
    "LyapunovFunction": "hoap3.remote_controller.tasks.lyapunov:LyapunovFunction",
    "RobotDescription": "hoap3.protocol.robot.description:RobotDescription",
    "Settings": "hoap3.protocol.config.settings:Settings",
    "Task": "hoap3.remote_controller.tasks.task:Task",
    "VelocityController": "hoap3.remote_controller.controllers.base:VelocityController",
    "bounds": "hoap3.remote_controller.bounds",
    "connect": "hoap3.tools.services.connection:connect",
    "load_robot": "hoap3.robot_emulator.robots:load",
    "simulate": "hoap3.tools.services.simulate:simulate",
    "solvers": "hoap3.remote_controller.solvers",
}
"""Where each name is that is loaded at its first use: a module, or a name in one."""


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in {"Environment", "simulate"}:
        from hoap3.tools.machine.processes import check_libraries, check_memory

        check_memory()
        check_libraries()
    module, _, attribute = _LAZY[name].partition(":")
    found: Any = importlib.import_module(module)
    if attribute:
        found = getattr(found, attribute)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "Environment"]
