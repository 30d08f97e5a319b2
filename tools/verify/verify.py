"""`hoap3 verify`: recompute what a log claims, and list every cycle whose claim is not true."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from hoap3.protocol.config.user_code import code_of_log
from hoap3.protocol.errors import ConfigError, DescriptionError, LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.trajectories_oracle import with_motions
from hoap3.tools.logs.log import NEVER_OURS, Log
from hoap3.tools.logs.log_format import SIDES
from hoap3.tools.verify.both_sides import check_both, enclosed_alike
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs
from hoap3.tools.verify.controller_order import check_order
from hoap3.tools.verify.forked import Forked, processors
from hoap3.tools.verify.leaving import check_leaving
from hoap3.tools.verify.records.log_times import check_log_times
from hoap3.tools.verify.records.repeated import check_repeated
from hoap3.tools.verify.robot_log import check_robot
from hoap3.tools.verify.statements import builder_of, check_engagements
from hoap3.tools.verify.targets_taken import check_targets

PARALLEL_FROM = 50_000
"""States from which on the parts of a verification run in processes of their own."""


@dataclass
class Part:
    """What one part of a verification found.

    Attributes:
        claims: of this part.
        outcomes, not_repeated: as of `Verification`; None where the controller is no part of it.
        undescribed: why the log's robot cannot be described, "" where it can.
        unreadable: why the log cannot be read, "" where it can.
    """

    claims: Claims = field(default_factory=Claims)
    outcomes: dict[int, dict[str, Any]] = field(default_factory=dict)
    not_repeated: str | None = None
    undescribed: str = ""
    unreadable: str = ""


Work = Callable[[Part, Callable[[str], None]], None]


@dataclass
class Verification:
    """What came of it.

    Attributes:
        log: what was verified.
        claims: all that was compared, and what could not be.
        missing: what of the log is lost, in words, "" for nothing.
        outcomes: what a controller's answers came to, by session of the robot, as a replay
            computes it again.
        not_repeated: why there is none, "" where there is.
    """

    log: str
    claims: Claims = field(default_factory=Claims)
    missing: str = ""
    outcomes: dict[int, dict[str, Any]] = field(default_factory=dict)
    not_repeated: str = "the controller was not repeated"

    @property
    def true(self) -> bool:
        """Whether all that the log claims was recomputed, and holds."""
        return self.verdict == "true"

    @property
    def verdict(self) -> str:
        """`false` where a claim does not hold, `not verified` where one could not be judged."""
        if self.claims.false:
            return "false"
        whole = self.claims.checked and not self.claims.unverifiable and not self.missing
        return "true" if whole else "not verified"

    def as_json(self) -> dict[str, Any]:
        """All of it."""
        return {
            "log": self.log,
            "verdict": self.verdict,
            "missing": self.missing,
            **self.claims.as_json(),
        }


def verify(
    path: Path,
    say: Callable[[str], None] = lambda _: None,
    *,
    repeat: bool = False,
    allow_code: bool = False,
    opened: Mapping[str, Log] | None = None,
    most_answers: int | None = None,
    every: bool = False,
) -> Verification:
    """Verify the log of a controller, of a robot, or both in the folder of a run.

    A long log is verified in several processes, as its parts do not depend on each other: the
    records of each side, the problems of its answers, the replay of the controller, and what both
    sides have.

    Args:
        path: `*.mcap`, or a folder.
        say: takes progress, for people.
        repeat: also replay the controller, for its summaries, events and session.
        allow_code: import what the log names by a dotted path: to replay it, and for the
            `problem_type` of a controller.
        opened: the logs by side, where they are open already.
        most_answers: certificates of about so many answers are checked, a random sample, where the
            controller's builder states its problems one by one; None: all where that is fast, else
            `statements.SAMPLE`.
        every: check the certificates of all answers.

    Raises:
        LogError: there is no log, or it cannot be read.
    """
    sides = opened.items() if opened else ((side, None) for side in _sides(path))
    found = [known or Log.open(path, side=side).load() for side, known in sides]
    logs = {log.side: log for log in found}
    most = sys.maxsize if every else most_answers
    parts: list[tuple[str, Work]] = []
    longest = 0  # the replay takes longest, and begins first
    for side, log in logs.items():
        parts.append((side, partial(_check_side, log, allow_code)))
        if side == "controller":
            parts.append((side, partial(_check_problems, log, most, allow_code)))
        if repeat and side == "controller":
            longest = len(parts)
            parts.append((side, partial(_repeat, log, allow_code=allow_code)))
    parts.append(("", partial(_check_together, logs)))
    states = sum(log.count(Kind.STATE) for log in found)
    works = [partial(_judged, path, work, allow_code) for _, work in parts]
    if processors() < 2 or states < PARALLEL_FROM:
        return _merged(path, logs, parts, (work(say) for work in works))
    forked = Forked([works.pop(longest), *works], processors())
    try:
        first, *results = forked.gather(say)
        return _merged(path, logs, parts, [*results[:longest], first, *results[longest:]])
    finally:
        forked.end()


def _merged(
    path: Path,
    logs: Mapping[str, Log],
    parts: Sequence[tuple[str, Work]],
    results: Iterable[Part],
) -> Verification:
    """Add the parts in their order."""
    whole, undescribed = Verification(str(path)), set[str]()
    for (side, _), part in zip(parts, results, strict=True):
        if part.unreadable:
            raise LogError(part.unreadable)
        if side in undescribed:  # there is nothing to repeat the controller with
            continue
        whole.claims.add(part.claims)
        if part.undescribed:
            undescribed.add(side)
            whole.claims.unverified(f"log of the {side}", 1, part.undescribed)
        elif part.not_repeated is not None:
            whole.outcomes, whole.not_repeated = part.outcomes, part.not_repeated
    lost = (f"{side}: {log.missing}" for side, log in logs.items() if log.missing)
    whole.missing = "; ".join(lost)
    return whole


def _judged(path: Path, work: Work, allow_code: bool, say: Callable[[str], None]) -> Part:
    """Do one part, and keep what it raises about the log; its code is imported if allowed."""
    part = Part()
    try:
        with code_of_log(allowed=allow_code):
            work(part, say)
    except ConfigError as error:
        part.claims.unverified("certificate", 1, f"{error!s:.240}")
    except DescriptionError as error:
        part.undescribed = str(error)
    except NEVER_OURS as error:
        reason = f"{type(error).__name__}: {error}"
        part.unreadable = f"{path}: holds what no service of ours writes ({reason})"
    except LogError as error:
        part.unreadable = str(error)
    return part


def _repeat(log: Log, part: Part, say: Callable[[str], None], *, allow_code: bool) -> None:
    config = "" if _config(log) is not None else "the log has no config"
    part.outcomes, part.not_repeated = check_repeated(
        log, part.claims, config, say, allow_code=allow_code
    )


def _check_together(logs: Mapping[str, Log], part: Part, _: Callable[[str], None]) -> None:
    for name, same in enclosed_alike(logs.values()).items():
        if same is None:
            part.claims.unverified(name, 1, "there is nothing to compare it with")
        else:
            part.claims.equal(name, 0, float(same), 1.0)
    if len(logs) == len(SIDES):
        check_both(logs["robot"], logs["controller"], part.claims)
    else:
        other = next(side for side in SIDES if side not in logs)
        part.claims.unverified("both logs", 1, f"there is no log of the {other}")


def _sides(path: Path) -> tuple[str | None, ...]:
    """Which logs there are; None for the one that is named."""
    if not path.is_dir():
        return (None,)
    there = tuple(side for side in SIDES if any(path.glob(f"{side}*.mcap")))
    return there or ("controller",)


def _check_side(log: Log, allow_code: bool, part: Part, say: Callable[[str], None]) -> None:
    say(f"log of the {log.side}")
    config, claims = _config(log), part.claims
    if config is None:
        claims.unverified(f"config of the {log.side}", 1, "the log has none that can be read")
    if "recorded" not in log.metadata.get("run", {}):
        check_log_times(log, _compute_time(config or {}), claims)
    if log.side == "robot":
        misses = (config or {}).get("misses_to_stop")
        hold = (config or {}).get("loss_policy") == "hold"
        check_robot(log, misses if isinstance(misses, int) else None, claims, hold=hold)
    else:
        _check_controller(log, config, claims, say, allow_code)


def _compute_time(config: dict[str, Any]) -> int | None:
    """How long after its State a setpoint arrives in virtual time [ns]; None: not known."""
    found = (config.get("lockstep") or {}).get("compute_time_us")
    return round(found * 1e3) if isinstance(found, int | float) else None


def _config(log: Log) -> dict[str, Any] | None:
    """The configuration in a log; None where there is none that can be read."""
    content = log.settings
    return None if content is None else with_motions(content, log.attachments)


def _check_controller(
    log: Log,
    config: dict[str, Any] | None,
    claims: Claims,
    say: Callable[[str], None],
    allow_code: bool,
) -> None:
    name, parameters = _controller(config)
    reason = "the log has no config" if config is None else ""
    try:
        if config is not None:
            builder_of(name, parameters, allow_code=allow_code)
    except UnverifiableError as error:
        reason = str(error)
    check_targets(log.records(Kind.SESSION, Kind.STATE, Kind.TARGET), parameters, claims)
    for run in runs(log.records()):
        check_order(run, claims)
        say(f"{len(run.answers)} answers")
        if reason:
            claims.unverified("certificate", len(run.answers), reason)
        else:
            check_leaving(run, parameters, claims)


def _check_problems(
    log: Log, most: int | None, allow_code: bool, part: Part, say: Callable[[str], None]
) -> None:
    """Check answers by the problems that the controller's builder states."""
    (name, parameters), answers = _controller(_config(log)), log.count(Kind.SETPOINT)
    options: dict[str, Any] = {"answers": answers, "most": most, "allow_code": allow_code}
    options["seed"] = _digest(log)  # an answer that is changed changes the sample as well
    say(f"problems of {answers} answers")
    with suppress(UnverifiableError):  # `_check_controller` has the reason
        check_engagements(log.records(), name, parameters, part.claims, say=say, **options)


def _digest(log: Log) -> int:
    """Of the files of a log; those that were deleted since it was read are left out."""
    found = hashlib.blake2b(digest_size=8)
    for path in log.paths:
        with suppress(FileNotFoundError), path.open("rb") as file:
            found.update(hashlib.file_digest(file, "blake2b").digest())
    return int.from_bytes(found.digest(), "little")


def _controller(config: Mapping[str, Any] | None) -> tuple[str, dict[str, Any]]:
    """The registered name of the controller of a config, "" for none, and its parameters."""
    config = config or {}
    return str(config.get("controller", "")), config.get("parameters") or {}
