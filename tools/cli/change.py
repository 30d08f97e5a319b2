"""Commands that change a controller while it runs: `hoap3 change` and `hoap3 priorities`."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from hoap3.tools.cli.options import ENDPOINT, finite
from hoap3.tools.machine.terminal import one_line

priorities_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Priorities of the tasks of a controller that runs.",
)
Robot = Annotated[
    str | None,
    typer.Option("--robot", help="Robot that it controls. Default: the only one that runs."),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        help=f"Endpoint of the robot or a router. Default: this machine's, else {ENDPOINT}.",
    ),
]
Over = Annotated[
    float,
    typer.Option("--over", min=0.0, callback=finite, help="Time that the change takes [s]."),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Tasks = Annotated[list[str], typer.Argument(help="Names of tasks.")]


def change(
    request: Annotated[str, typer.Argument(help="JSON object of the controller's own making.")],
    robot: Robot = None,
    connect: Connect = None,
) -> None:
    """Change something in a controller that runs; its log has it, and a replay repeats it."""
    from hoap3.protocol.errors import UsageError
    from hoap3.tools.show.output import print_json

    try:
        content = json.loads(request)
    except ValueError as error:
        raise UsageError(f"{request!r:.60} is not JSON ({error})") from error
    if not isinstance(content, dict):
        raise UsageError(
            f"{request!r:.60} is no JSON object: write what the controller takes, such as "
            '\'{"order": ["foot", "com", "posture"]}\' with ghc_velocity'
        )
    print_json(_ask(robot, content, connect)[1])


@priorities_app.command("show")
def show_priorities(robot: Robot = None, connect: Connect = None, as_json: AsJson = False) -> None:
    """Say what they are: α of the task of each row, kept out of those of the columns."""
    _tell(robot, None, connect, as_json)


@priorities_app.command("set")
def set_priority(
    lower: Annotated[str, typer.Argument(help="Task that is kept out of the other.")],
    upper: Annotated[str, typer.Argument(help="Task that it is kept out of.")],
    value: Annotated[
        float,
        typer.Argument(min=0.0, max=1.0, callback=finite, help="α: 1 wholly, 0 not at all."),
    ],
    over: Over = 0.0,
    robot: Robot = None,
    connect: Connect = None,
    as_json: AsJson = False,
) -> None:
    """Give a task a priority over another; the opposite one becomes 1 − α."""
    _tell(robot, {"set": [[lower, upper, value]], "over_s": over}, connect, as_json)


@priorities_app.command("order")
def order_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = None,
    connect: Connect = None,
    as_json: AsJson = False,
) -> None:
    """Put tasks in a strict order, highest first; `A,B` puts two at one level."""
    levels = [task.split(",") if "," in task else task for task in tasks]
    _tell(robot, {"order": levels, "over_s": over}, connect, as_json)


@priorities_app.command("insert")
def insert_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = None,
    connect: Connect = None,
    as_json: AsJson = False,
) -> None:
    """Let tasks in that are out, at the priorities that they had."""
    _tell(robot, {"insert": tasks, "over_s": over}, connect, as_json)


@priorities_app.command("remove")
def remove_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = None,
    connect: Connect = None,
    as_json: AsJson = False,
) -> None:
    """Take tasks out; `insert` lets them in again."""
    _tell(robot, {"remove": tasks, "over_s": over}, connect, as_json)


def _ask(
    robot: str | None, request: dict[str, Any] | None, connect: str | None
) -> tuple[str, dict[str, Any]]:
    """Name of the robot, and what its controller answers."""
    from hoap3.tools.cli.find_robot import reach_robot
    from hoap3.tools.services.client import change as ask

    name, endpoint = reach_robot(robot, connect)
    return name, ask(name, request, endpoint)


def _tell(
    robot: str | None, request: dict[str, Any] | None, connect: str | None, as_json: bool
) -> None:
    from hoap3.protocol.errors import UsageError
    from hoap3.tools.show.output import print_json, print_line

    name, answer = _ask(robot, request, connect)
    present = answer.get("priorities")
    if present is None:
        raise UsageError(
            f"the controller of {name!r} has no priorities; ghc, ghc_velocity and hqp have"
        )
    from hoap3.protocol.answers import Priorities, check_answer

    found = check_answer(Priorities, present, f"the controller of {name!r} answers")
    if as_json:
        print_json(found.model_dump())
        return
    from hoap3.tools.show.summary import show_matrix

    show_matrix("α", found.names, found.alpha)
    if found.moving:
        print_line("on its way")
    if found.out:
        names = one_line(", ".join(found.out))
        print_line(f"out: {names}; what is set for them holds once they are inserted")
