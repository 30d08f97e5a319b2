"""Answers of a robot and of its controller, checked as strictly as messages.

Every answer from the network passes here before anything else looks at it. What does not fit
raises `WireError` of the kind "answer", which says who answered what, and what was expected.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import from_json

from hoap3.protocol.errors import DescriptionError, WireError
from hoap3.protocol.robot.description import MAX_DELAY_TICKS, DeadlineRule, RobotDescription

MAX_ANSWER_BYTES = 4096  # of a robot; its description has a limit of its own
MAX_CONTROL_BYTES = 1 << 20  # of a controller, whose matrices are part of the answer

Uint64 = Annotated[int, Field(ge=0, le=2**64 - 1)]
Kind = TypeVar("Kind", bound="Answer")


class Answer(BaseModel):
    """Base of all: exact types, finite numbers; keys that are not known are left out."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)


class Status(Answer):
    """What a robot does.

    Attributes:
        mode: of its motion; "starting" before it has any.
        holder: client that has authority, or None. Any text: escape it before it is shown.
        session_id: one run of the robot's schedule.
        tick: the newest one.
        lockstep: whether the robot's time is virtual.
        stop_reason: why it stops or is stopped, as `hoap3.protocol.stop_reasons` names it; None
            where it does neither, or does not tell, as older robots do not.
        counts: deadlines and limits so far, as the robot's summary has them; None: not known.
        name_conflicts: how many other robots on its network use its name.
    """

    mode: Literal["starting", "idle", "active", "stopping", "stopped"]
    holder: Annotated[str, Field(max_length=64)] | None
    session_id: Uint64
    tick: Uint64
    lockstep: bool
    stop_reason: Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")] | None = None
    counts: dict[str, Any] | None = None
    name_conflicts: Uint64 = 0


class Recovery(Status):
    """Answer to "recover".

    Attributes:
        recovered: False where the robot was not stopped.
    """

    recovered: bool


class Release(Answer):
    """Answer to "release".

    Attributes:
        released: False where nothing was held.
    """

    released: bool


class GrantAnswer(Status):
    """Answer to "acquire".

    Attributes:
        granted: whether the client has authority now.
        epoch, from_tick: of a grant, None otherwise.
        deadline, delay_ticks: as the robot's description has them; older robots leave them out.
        setpoint_arrays: how long arrays of a Setpoint may be, by name; of older robots empty.
        reason: of a refusal, in one word, or None.
    """

    granted: bool
    epoch: Annotated[int, Field(ge=1, le=2**64 - 1)] | None = None
    from_tick: Uint64 | None = None
    deadline: DeadlineRule = "next_tick"
    delay_ticks: Annotated[int, Field(ge=0, le=MAX_DELAY_TICKS)] = 0
    setpoint_arrays: dict[str, Annotated[int, Field(ge=0)]] = {}
    reason: Annotated[str, Field(max_length=64)] | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.granted and (self.epoch is None or self.from_tick is None):
            raise ValueError("a grant needs epoch and from_tick")
        return self


class ControlAnswer(Answer):
    """Answer of a controller.

    Attributes:
        error: why nothing was changed, or None.
        now: what can be changed, as it is now; None beside an error.
    """

    error: Annotated[str, Field(max_length=65_536)] | None
    now: dict[str, Any] | None

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.error is None) == (self.now is None):
            raise ValueError("one of error and now must be null, the other must not")
        return self


class Steered(Answer):
    """A live target, as its operator must know it.

    Attributes:
        name: of the target.
        dimension, rates: numbers of a point, and of a rate.
        lower, upper: limits of its first numbers, null where there is none.
        at_rest: whether it has come to the end of what was sent; None: not known.
    """

    name: str
    dimension: Annotated[int, Field(ge=1, le=65_536)]
    rates: Annotated[int, Field(ge=1, le=65_536)]
    layout: list[str] = []
    lower: list[float | None] = []
    upper: list[float | None] = []
    at_rest: bool | None = None


class OperatorAnswer(Answer):
    """What a controller tells whoever steers.

    Attributes:
        epoch, session_id: that targets carry.
        following: whether the robot follows the controller.
        targets: all that can be steered, in the order of their numbers.
        taken, late_points, lost, refused: counts of messages, the last by reason.
        newest: number of the last message that has come; controllers before this one do not tell.
    """

    epoch: Uint64
    session_id: Uint64
    following: bool
    targets: list[Steered]
    taken: Uint64
    late_points: Uint64
    lost: Uint64 = 0
    refused: dict[str, int]
    newest: Uint64 | None = None


ROBOT_ANSWERS: dict[str, type[Answer]] = {
    "status": Status,
    "stop": Status,
    "recover": Recovery,
    "release": Release,
    "acquire": GrantAnswer,
}
"""What a robot answers, by the verb of the request; "description" has a function of its own."""


def parse_answer(model: type[Kind], raw: bytes, who: str, limit: int = MAX_ANSWER_BYTES) -> Kind:
    """An answer as a `model`.

    Args:
        model: what is expected.
        raw: what arrived.
        who: who answered what, for the error: "robot 'arm' answers 'status'".
        limit: greatest size [bytes].

    Raises:
        WireError: too long, not JSON, or not such an answer.
    """
    if len(raw) > limit:
        raise WireError("answer", f"{who} with {len(raw)} bytes; at most {limit} are accepted")
    try:
        content = from_json(raw, allow_inf_nan=False)
    except ValueError as error:
        raise WireError("answer", f"{who} with something that is not JSON ({error})") from error
    if isinstance(content, dict) and isinstance(content.get("error"), str) and len(content) == 1:
        raise WireError("answer", f"{who} with the error {content['error']!r:.200}")
    return check_answer(model, content, who)


def check_answer(model: type[Kind], content: object, who: str) -> Kind:
    """The same for what has been parsed.

    Raises:
        WireError: not such an answer.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        finding = error.errors(include_url=False, include_context=False)[0]
        key = ".".join(str(place)[:60] for place in finding["loc"]) or "it"
        found = "" if finding["type"] == "missing" else f", found {finding['input']!r:.60}"
        what = finding["msg"].removeprefix("Value error, ")
        raise WireError("answer", f"{who} with nonsense: {key!r}: {what}{found}") from error


def parse_description(raw: bytes, robot: str) -> RobotDescription:
    """A robot's description, which must bear the name that it was asked under.

    Raises:
        WireError: not a description that holds together, or of another robot.
    """
    who = f"robot {robot!r} answers 'description'"
    try:
        description = RobotDescription.from_json(raw)
    except DescriptionError as error:
        if raw.startswith(b'{"error":'):
            parse_answer(Status, raw, who)  # which raises what the robot reports
        raise WireError("answer", f"{who} with nonsense: {error}") from error
    if description.name != robot:
        raise WireError("answer", f"{who} with that of another robot, {description.name!r}")
    return description
