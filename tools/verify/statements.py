"""Checks the answers of a controller's log by the problems that its builder states."""

from __future__ import annotations

import json
import random
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any

import numpy as np

from hoap3.protocol.config.plugins import blame
from hoap3.protocol.config.user_code import code_of_log
from hoap3.protocol.errors import UsageError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.singularity import LEAVING
from hoap3.remote_controller.problems.check import check
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.registry import BUILTIN, find
from hoap3.tools.verify.claims import Claims

BUILDERS = {
    "clik": "clik_sdp:ClikProblems",
    "clik_sdp": "clik_sdp:ClikSdpProblems",
    "ghc": "ghc:GhcProblems",
    "ghc_torque": "ghc:GhcTorqueProblems",
    "ghc_velocity": "ghc_velocity:GhcVelocityProblems",
    "hqp": "hqp:HqpProblems",
    "joint_acceleration": "joint_acceleration:JointAccelerationProblems",
    "osqp": "qp12:OsqpProblems",
    "pinv": "qp12:PinvProblems",
    "qp12": "qp12:Qp12Problems",
    "stable_qp": "stable_qp:StableQpProblems",
    "tsid": "tsid:TsidProblems",
    "weighted": "weighted:WeightedProblems",
}
WITH_FREE_BASE = {
    "ghc": "free_base_optima:GhcFreeProblems",
    "hqp": "free_base_optima:HqpFreeProblems",
    "tsid": "free_base_optima:TsidFreeProblems",
    "weighted": "free_base_optima:WeightedFreeProblems",
}
"""Module and class in `remote_controller.problems`, by the controller's registered name, with
`base: fixed` and `base: free`."""
SAMPLE = 20_000
"""Answers that are checked by default where each takes a millisecond or more."""
MISSING = "not finite, or the log lacks when the controller began"
LEFT = "the controller leaves a singularity"
NOTHING = "its problem_type states nothing of the answer"
PART = 5000  # answers whose findings are counted together


def builder_of(
    controller: str, parameters: Mapping[str, Any], *, allow_code: bool = False
) -> type[ProblemBuilder]:
    """The builder of a controller's problems.

    Args:
        controller: registered, or a dotted path.
        parameters: of the log's config.
        allow_code: import what is named by a dotted path; what is installed always is.

    Raises:
        UnverifiableError: a user's controller that cannot be imported or has no `problem_type`.
    """
    if controller not in BUILTIN:
        return _problem_type(controller, allow_code=allow_code)
    free = parameters.get("base") == "free" and controller in WITH_FREE_BASE
    module, name = (WITH_FREE_BASE if free else BUILDERS)[controller].split(":")
    module = f"hoap3.remote_controller.problems.{module}"
    found: type[ProblemBuilder] = getattr(import_module(module), name)
    return found


def _problem_type(controller: str, *, allow_code: bool) -> type[ProblemBuilder]:
    """The builder that a user's controller names."""
    try:
        with code_of_log(allowed=allow_code):
            found = find(controller).problem_type
    except UsageError as error:
        raise UnverifiableError(f"{error!s:.240}") from error
    if not (isinstance(found, type) and issubclass(found, ProblemBuilder)):
        raise UnverifiableError(f"controller {controller!r:.60} names no problem_type")
    return found


@np.errstate(all="ignore")  # numbers of a log may overflow; what is not finite does not hold
def check_statements(
    records: Iterable[Record],
    builder: ProblemBuilder,
    claims: Claims,
    *,
    share: float = 1.0,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Check the answers of one engagement.

    Args:
        records: of the engagement, in the order of the log.
        builder: of the problems of its controller.
        claims: takes what was compared, and how many answers were not in the sample.
        share: of the answers that are checked, a random sample.
        seed: of the sample.
        say: takes progress, for people.
    """
    chance = random.Random(seed)
    gathered: dict[str, array[float]] = {}
    missing = leaving = 0
    try:
        for kind, _, payload in records:
            builder.feed(kind, payload)
            if kind != Kind.SETPOINT:
                continue
            if any(each.startswith(LEAVING) for each in builder.history.conditions):
                leaving += 1
                continue
            claims.answers += 1
            if claims.answers % PART == 0:
                say(f"problems of {claims.answers} answers")
                _count(gathered, claims)
            if share < 1.0 and chance.random() >= share:
                claims.left_out += 1
                continue
            statement = builder.problem()
            if statement is None:
                missing += 1
                continue
            if not (statement.problems or statement.claims or statement.unverified):
                claims.unverified("certificate", 1, NOTHING)
            for name, reason in statement.unverified:
                claims.unverified(name, 1, reason)
            tick = float(builder.history.state["tick"])
            for name, *numbers in check(statement):
                gathered.setdefault(name, array("d")).extend((tick, *numbers))
    finally:
        _count(gathered, claims)
        claims.unverified("certificate", missing, MISSING)
        claims.unverified("certificate", leaving, LEFT)


def check_engagements(
    records: Iterable[Record],
    controller: str,
    parameters: Mapping[str, Any],
    claims: Claims,
    *,
    answers: int = 0,
    most: int | None = None,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
    allow_code: bool = False,
) -> None:
    """Check the answers of a controller's log by its builder.

    What a user's builder raises is the reason why the answers are not verified.

    Args:
        records: all of the log.
        controller: its name.
        parameters: of the log's config.
        claims: takes what was compared.
        answers: how many the log has.
        most: about how many of them are checked, a random sample; None: all of a controller whose
            builder is fast enough, else `SAMPLE`.
        seed: of the sample.
        say: takes progress, for people.
        allow_code: as for `builder_of`.

    Raises:
        UnverifiableError: as of `builder_of`.
    """
    kind = builder_of(controller, parameters, allow_code=allow_code)
    if most is None and not kind.checks_every_answer:
        most = SAMPLE
    own = (Exception, SystemExit)  # a user's builder must not end the verification
    expected = (UnverifiableError, UsageError) if controller in BUILTIN else own
    share = 1.0 if most is None else min(1.0, most / max(answers, 1))
    description: RobotDescription | None = None
    reader, lost = iter(records), 0
    record = next(reader, None)
    while record is not None:
        if record.kind == Kind.DESCRIPTION:
            description = RobotDescription.from_json(record.payload)
        lost += record.kind == Kind.SETPOINT
        if record.kind != Kind.SESSION or description is None:
            record = next(reader, None)
            continue
        engagement, failed_at = _Engagement(reader), 0
        try:
            session = json.loads(record.payload)
            with code_of_log(allowed=allow_code):  # a builder imports users' tasks
                builder = kind(description, parameters, session, controller)
                failed_at = 1  # from here on, an error is raised at an answer that was read
                check_statements(engagement, builder, claims, share=share, seed=seed, say=say)
        except expected as error:
            rest = sum(each.kind == Kind.SETPOINT for each in engagement)
            known = isinstance(error, UnverifiableError | UsageError)
            reason = str(error) if known else blame(error, kind)
            claims.unverified("certificate", rest + failed_at, f"{reason:.240}")
        description = engagement.description or description
        record = engagement.following
    claims.unverified("certificate", lost, "there is no description or session before it")


class _Engagement:
    """Records up to the next session.

    Attributes:
        following: the session that comes next.
        description: of the robot of what follows, where there is one.
    """

    def __init__(self, reader: Iterator[Record]) -> None:
        self._reader = reader
        self.following: Record | None = None
        self.description: RobotDescription | None = None

    def __iter__(self) -> Iterator[Record]:
        for record in self._reader:
            if record.kind == Kind.SESSION:
                self.following = record
                return
            if record.kind == Kind.DESCRIPTION:
                self.description = RobotDescription.from_json(record.payload)
            yield record


def _count(gathered: dict[str, array[float]], claims: Claims) -> None:
    """Hand findings over, by their names: tick, and the four numbers of a `Finding`."""
    for name, found in gathered.items():
        claims.compared(name, *np.array(found).reshape(-1, 5).T)
    gathered.clear()
