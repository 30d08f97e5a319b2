"""Commands that change a controller while it runs: `hoap3 change` and `hoap3 priorities`."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from tools.cli_options import finite
from tools.terminal import one_line

priorities_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Priorities of the tasks of a controller that runs.",
)
Robot = Annotated[str, typer.Option("--robot", help="Name of the robot that it controls.")]
Connect = Annotated[str, typer.Option("--connect", help="Endpoint of the robot or a router.")]
Over = Annotated[
    float,
    typer.Option("--over", min=0.0, callback=finite, help="Time that the change takes [s]."),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Tasks = Annotated[list[str], typer.Argument(help="Names of tasks.")]
ENDPOINT = "tcp/127.0.0.1:7447"


def change(
    request: Annotated[str, typer.Argument(help="JSON object of the controller's own making.")],
    robot: Robot = "hoap3",
    connect: Connect = ENDPOINT,
) -> None:
    """Change something in a controller that runs; its log has it, and a replay repeats it."""
    from protocol.errors import UsageError
    from tools.output import print_json

    try:
        content = json.loads(request)
    except ValueError as error:
        raise UsageError(f"{request!r:.60} is not JSON ({error})") from error
    if not isinstance(content, dict):
        raise UsageError(f"{request!r:.60} is no JSON object: write '{{\"kp\": 20}}', say")
    print_json(_ask(robot, content, connect))


@priorities_app.command("show")
def show_priorities(
    robot: Robot = "hoap3", connect: Connect = ENDPOINT, as_json: AsJson = False
) -> None:
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
    robot: Robot = "hoap3",
    connect: Connect = ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Give a task a priority over another; the opposite one becomes 1 − α."""
    _tell(robot, {"set": [[lower, upper, value]], "over_s": over}, connect, as_json)


@priorities_app.command("order")
def order_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = "hoap3",
    connect: Connect = ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Put tasks in a strict order, highest first; `A,B` puts two at one level."""
    levels = [task.split(",") if "," in task else task for task in tasks]
    _tell(robot, {"order": levels, "over_s": over}, connect, as_json)


@priorities_app.command("insert")
def insert_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = "hoap3",
    connect: Connect = ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Let tasks in that are out, at the priorities that they had."""
    _tell(robot, {"insert": tasks, "over_s": over}, connect, as_json)


@priorities_app.command("remove")
def remove_tasks(
    tasks: Tasks,
    over: Over = 0.0,
    robot: Robot = "hoap3",
    connect: Connect = ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Take tasks out; `insert` lets them in again."""
    _tell(robot, {"remove": tasks, "over_s": over}, connect, as_json)


def _ask(robot: str, request: dict[str, Any] | None, connect: str) -> dict[str, Any]:
    from tools.control import change as ask

    return ask(robot, request, connect)


def _tell(robot: str, request: dict[str, Any] | None, connect: str, as_json: bool) -> None:
    from protocol.errors import UsageError
    from tools.output import print_json, print_line

    present = _ask(robot, request, connect).get("priorities")
    if present is None:
        raise UsageError(
            f"the controller of {robot!r} has no priorities; ghc, ghc_velocity and hqp have"
        )
    from protocol.answers import Priorities, check_answer

    found = check_answer(Priorities, present, f"the controller of {robot!r} answers")
    if as_json:
        print_json(found.model_dump())
        return
    from tools.show import show_matrix

    show_matrix("α", found.names, found.alpha)
    if found.moving:
        print_line("on its way")
    if found.out:
        names = one_line(", ".join(found.out))
        print_line(f"out: {names}; what is set for them holds once they are inserted")
