"""Requests to a running robot: `stop`, `recover`, `status`, `change`."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated, Any

import typer

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.tools.analysis.output import print_json, print_line, print_note, print_result
from hoap3.tools.cli.options import AsJson, Connect, Secure, reached
from hoap3.tools.machine.processes import one_line, to_people

RESUME_S = 2.0  # a controller that waits asks for authority five times a second
LOOK_S = 0.1


def show_answers(robot: str | None, verb: str, connect: str | None, as_json: bool) -> None:
    """Send a request to the running robots of one name, and show their answers."""
    from hoap3.tools.services.find_robot import ask_robots

    answers, failures = ask_robots(robot, verb, connect)
    several = len(answers) + len(failures) > 1
    if answers[0].get("recovered"):
        answers[0] |= _await_controller(answers[0], connect)
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


def _await_controller(answer: dict[str, Any], connect: str | None) -> dict[str, Any]:
    """The status of a recovered robot once its controller moves it, or after `RESUME_S`."""
    from hoap3.tools.services.find_robot import ask_robots

    status, until = answer, time.monotonic() + RESUME_S
    session = answer.get("session_id")  # others may have the same name
    with suppress(Hoap3Error):
        while status["mode"] == "idle" and time.monotonic() < until:
            time.sleep(LOOK_S)
            found = ask_robots(answer["robot"], "status", connect)[0]
            status = next((each for each in found if each.get("session_id") == session), status)
    return status


def _show_answer(answer: dict[str, Any], connect: str | None, *, place: bool) -> None:
    from hoap3.protocol.link.local_control import NOT_STARTED
    from hoap3.protocol.stop_reasons import recovery_words, stop_words, waits_for_recovery

    if answer.get("recovered") is False:
        return
    name = answer["robot"]
    if answer["mode"] == "starting":
        print_line(f"{name} {NOT_STARTED}")
        return
    holder = answer["holder"]
    who = f"follows {one_line(holder)}" if holder else "no controller"
    words = f"{name}: {answer['mode']}, {who}"
    if waits_for_recovery(answer["mode"], answer.get("stop_reason")):
        words += f"; {stop_words(answer.get('stop_reason'))}: {recovery_words(name, connect)}"
    elif answer["mode"] == "idle" and not answer["holder"]:
        words += "; start one to move it"
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


_EXAMPLE = '\'{"order": ["foot", "com", "posture"]}\''


def change(
    request: Annotated[
        list[str] | None,
        typer.Argument(
            help="KEY=VALUE of numbers that may change, such as gamma=0.8 over_s=1; or one JSON "
            "object. Default: show the present values."
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Robot of the controller. Default: the only one that runs."),
    ] = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Change gains, limits, weights or priorities of a running controller; recorded in its log."""
    from hoap3.tools.services import sent
    from hoap3.tools.services.client import tool_client
    from hoap3.tools.services.find_robot import reach_robot

    content = _content(request or [])
    with tool_client(*reach_robot(robot, reached(connect, secure))) as client:
        before = client.control("show")
        if content is None:
            print_json(before)
            return
        answer = client.control("change", sent.request(content, {}))
    print_result(answer, sent.describe_change(content, before), as_json=as_json)
    shown = "these are the values at the start of the transition; " if as_json else ""
    print_note(f"accepted; {shown}`hoap3 change` shows the present values")


def _content(given: Sequence[str]) -> dict[str, Any] | None:
    """What shall be otherwise; None where nothing is given.

    Raises:
        UsageError: neither a JSON object nor KEY=VALUE.
    """
    if not given:
        return None
    if len(given) > 1 or given[0].lstrip()[:1] not in {"{", "["}:
        return _pairs(given)
    try:
        content = json.loads(given[0])
    except ValueError as error:
        raise UsageError(f"{given[0]!r:.60} is not JSON ({error})") from error
    if not isinstance(content, dict):
        raise UsageError(
            f"{given[0]!r:.60} is no JSON object: write what the controller takes, such as "
            f"gamma=0.8 with qp12, or {_EXAMPLE} with ghc_velocity"
        )
    return content


def _pairs(given: Sequence[str]) -> dict[str, Any]:
    from hoap3.protocol.config.settings import apply_overrides

    content: dict[str, Any] = {}
    for pair in given:
        key, equals, _ = pair.partition("=")
        if not equals or not key.strip():
            raise UsageError(
                f"{pair!r:.60} is not KEY=VALUE, such as gamma=0.8: write so, or one JSON object"
            )
        content = apply_overrides(content, [pair])
    return content
