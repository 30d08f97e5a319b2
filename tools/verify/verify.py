"""`hoap3 verify`: recompute what a log claims, and list every cycle whose claim is not true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import DescriptionError, LogError
from hoap3.tools.logs.log import NEVER_OURS, Log
from hoap3.tools.logs.log_format import SIDES
from hoap3.tools.verify.both_sides import check_both, enclosed_alike
from hoap3.tools.verify.checkers import checker_of
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs
from hoap3.tools.verify.controller_order import check_order
from hoap3.tools.verify.controllers.leaving import check_leaving
from hoap3.tools.verify.records.log_times import check_log_times
from hoap3.tools.verify.records.repeated import check_repeated
from hoap3.tools.verify.robot_log import check_robot
from hoap3.tools.verify.tasks.changes import with_numbers
from hoap3.tools.verify.tasks.trajectories import with_motions


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
) -> Verification:
    """Verify the log of a controller, of a robot, or both in the folder of a run.

    Args:
        path: `*.mcap`, or a folder.
        say: takes progress, for people.
        repeat: also replay the controller, for its summaries, events and session.
        allow_code: import for that what the log names by a dotted path.

    Raises:
        LogError: there is no log, or it cannot be read.
    """
    found, missing, logs = Verification(str(path)), [], {}
    for side in _sides(path):
        log = Log.open(path, side=side)
        logs[log.side] = log
        say(f"log of the {log.side}")
        try:
            _check_side(log, found.claims, say)
            if repeat and log.side == "controller":
                config = "" if _config(log) is not None else "the log has no config"
                found.outcomes, found.not_repeated = check_repeated(
                    log, found.claims, config, allow_code=allow_code
                )
        except DescriptionError as error:
            found.claims.unverified(f"log of the {log.side}", 1, str(error))
        except NEVER_OURS as error:
            reason = f"{type(error).__name__}: {error}"
            raise LogError(f"{path}: holds what no service of ours writes ({reason})") from error
        if log.missing:
            missing.append(f"{log.side}: {log.missing}")
    try:
        for name, same in enclosed_alike(logs.values()).items():
            if same is None:
                found.claims.unverified(name, 1, "there is nothing to compare it with")
            else:
                found.claims.equal(name, 0, float(same), 1.0)
    except NEVER_OURS as error:
        raise LogError(f"{path}: holds what no service of ours writes ({error})") from error
    if len(logs) == len(SIDES):
        check_both(logs["robot"], logs["controller"], found.claims)
    else:
        other = next(side for side in SIDES if side not in logs)
        found.claims.unverified("both logs", 1, f"there is no log of the {other}")
    found.missing = "; ".join(missing)
    return found


def _sides(path: Path) -> tuple[str | None, ...]:
    """Which logs there are; None for the one that is named."""
    if not path.is_dir():
        return (None,)
    there = tuple(side for side in SIDES if any(path.glob(f"{side}*.mcap")))
    return there or ("controller",)


def _check_side(log: Log, claims: Claims, say: Callable[[str], None]) -> None:
    config = _config(log)
    if config is None:
        claims.unverified(f"config of the {log.side}", 1, "the log has none that can be read")
    if "recorded" not in log.metadata.get("run", {}):
        check_log_times(log, _compute_time(config or {}), claims)
    if log.side == "robot":
        misses = (config or {}).get("misses_to_stop")
        hold = (config or {}).get("loss_policy") == "hold"
        check_robot(log, misses if isinstance(misses, int) else None, claims, hold=hold)
    else:
        _check_controller(log, config, claims, say)


def _compute_time(config: dict[str, Any]) -> int | None:
    """How long after its State a setpoint arrives in virtual time [ns]; None: not known."""
    found = (config.get("lockstep") or {}).get("compute_time_us")
    return round(found * 1e3) if isinstance(found, int | float) else None


def _config(log: Log) -> dict[str, Any] | None:
    """The configuration in a log; None where there is none that can be read."""
    content = log.settings
    return None if content is None else with_motions(content, log.attachments)


def _check_controller(
    log: Log, config: dict[str, Any] | None, claims: Claims, say: Callable[[str], None]
) -> None:
    name = str((config or {}).get("controller", ""))
    check = checker_of(name)
    reason = "the log has no config" if config is None else f"controller {name!r:.60} is not known"
    for run in runs(log.records()):
        check_order(run, claims)
        say(f"{len(run.answers)} answers")
        if check is None:
            claims.unverified("certificate", len(run.answers), reason)
        elif len(run.answers):
            for part, parameters in with_numbers(run, name, (config or {}).get("parameters") or {}):
                check(check_leaving(part, parameters, claims), parameters, claims)
