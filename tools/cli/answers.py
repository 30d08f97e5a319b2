"""What running robots answer to `hoap3 stop`, `recover` and `status`."""

from __future__ import annotations

from typing import Any

import typer

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.machine.processes import to_people
from hoap3.tools.machine.terminal import one_line
from hoap3.tools.show.output import print_json, print_line


def show_answers(robot: str | None, verb: str, connect: str | None, as_json: bool) -> None:
    """Send a request to the running robots of one name, and show their answers."""
    from hoap3.tools.services.find_robot import ask_robots

    answers, failures = ask_robots(robot, verb, connect)
    several = len(answers) + len(failures) > 1
    if verb == "status":
        answers = [
            {**answer, "tasks": None if several else _tasks(answer, connect)} for answer in answers
        ]
    if as_json:
        print_json({"robots": answers} if several else answers[0])
    else:
        for answer in answers:
            _show_answer(answer, connect, place=several or verb == "status")
    name = answers[0]["robot"]
    failed = answers[0].get("recovered") is False
    if failed:
        mode = answers[0]["mode"]
        to_people(f"error: {name} is {mode}: only a stopped robot can be recovered")
    if several:
        to_people(
            f"{len(answers) + len(failures)} robots are called {name!r}. Start all but one under "
            "other names: --set name=NAME"
        )
    for failure in failures:
        to_people(f"error: {failure}")
    if failed or failures:
        raise typer.Exit(1)


def _show_answer(answer: dict[str, Any], connect: str | None, *, place: bool) -> None:
    from hoap3.protocol.stop_reasons import recovery_words, stop_words, waits_for_recovery

    if answer.get("recovered") is False:
        return
    name = answer["robot"]
    words = f"{name}: {answer['mode']}, follows {one_line(answer['holder'] or 'nobody')}"
    if waits_for_recovery(answer["mode"], answer.get("stop_reason")):
        words += f"; {stop_words(answer.get('stop_reason'))}: {recovery_words(name, connect)}"
    print_line(words)
    if place:
        print_line(f"  at {place_of(answer)}")
    if answer["name_conflicts"]:
        print_line(f"  name conflict: other robots with its name: {answer['name_conflicts']}")
    for task in answer.get("tasks") or ():
        if task.get("reason"):
            label = one_line(str(task.get("task", "")))
            print_line(f"  task {label} has failed: {one_line(str(task['reason']))}")


def place_of(answer: dict[str, Any]) -> str:
    """Endpoint, process and session of a robot, as far as they are known."""
    host = f" on {answer['host']}" if answer.get("host") else ""
    process = f", process {answer['pid']}{host}" if answer["pid"] is not None else ""
    return one_line(
        f"{answer['endpoint'] or 'no endpoint'}{process}, session {answer['session_id']}"
    )


def _tasks(answer: dict[str, Any], connect: str | None) -> list[dict[str, Any]] | None:
    """Errors of the controller's tasks; None where they are not known."""
    from hoap3.tools.services.client import task_errors
    from hoap3.tools.services.find_robot import reach_robot

    if answer["mode"] != "active" or answer["lockstep"]:
        return None
    try:
        return task_errors(*reach_robot(answer["robot"], connect))
    except Hoap3Error:  # Zenoh does not reach it
        return None
