"""The cases: what both revisions run. Only inputs stand here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoap3.remote_controller.pairs import PAIRS, POSTURES

SECONDS = "3"
QUICK_PAIRS = {
    ("qp12", "hoap3"),
    ("osqp", "ur5"),
    ("stable_qp", "humanoid32"),
    ("clik_sdp", "lwr"),
    ("tsid", "baxter"),
    ("ghc_velocity", "hoap3"),
    ("hqp", "lwr_weightless"),
    ("ghc_force", "lwr_with_table"),
    ("obstacle", "hoap3"),
    ("tsid_standing", "hoap3_standing_torque"),
}
INPUTS = Path(__file__).with_name("inputs")


@dataclass(frozen=True)
class Step:
    """One command of a case.

    Attributes:
        output: name of the file for exit code and JSON; empty: the exit code is not compared.
        words: `hoap3` or the path of a script, and its arguments. `{logs}` stands for the folder of
            logs that the old revision has made.
        background: started, and ended with the case.
    """

    output: str
    words: tuple[str, ...]
    background: bool = False


@dataclass(frozen=True)
class Case:
    """Commands that run in an empty folder; all files that they leave there are compared.

    Attributes:
        name: with a group before the slash.
        steps: in their order.
        quick: whether `--quick` runs it.
        logs: logs of the old revision that it reads.
        ignored: globs of fields that differ from run to run in this case, with the reason.
    """

    name: str
    steps: tuple[Step, ...]
    quick: bool = False
    logs: tuple[str, ...] = ()
    ignored: tuple[tuple[str, str], ...] = ()


def lockstep(controller: str, robot: str, *settings: str, seconds: str = SECONDS) -> Step:
    """A run on virtual time with its log in `log`."""
    words = "--controller", controller, "--robot", robot, "--duration", seconds, "--seed", "0"
    sets = [word for setting in settings for word in ("--set", setting)]
    return Step("run", ("hoap3", "run", "--lockstep", "--json", "--out", "log", *words, *sets))


def pairs() -> list[Case]:
    """Each shipped controller config on each robot that it runs on."""
    cases = []
    for controller, robots in PAIRS.items():
        for robot in robots:
            posture = POSTURES.get((controller, robot))
            settings = [f"emulator.posture={posture}"] if posture else []
            name, quick = f"pairs/{controller}-{robot}", (controller, robot) in QUICK_PAIRS
            cases.append(Case(name, (lockstep(controller, robot, *settings),), quick))
    return cases


def all_cases() -> list[Case]:
    """Every case, those that take longest first."""
    return pairs()
