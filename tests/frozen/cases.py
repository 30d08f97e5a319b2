"""The cases: what both revisions run. Only inputs stand here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoap3.remote_controller.pairs import PAIRS, POSTURES

from .damage import DAMAGES

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
QUICK = {"changes_qp12", "steering_ur5", "delay_3", "late", "lockstep/qp12", "realtime/misses"}
"""Further cases of `--quick`, by the last part of their names."""
COMPARE = "--no-timing", "--json", "--out", "compared"
LATE = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=60"
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
        ignored: globs of fields that differ from run to run, with the reason.
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


LOGS: dict[str, Step | None] = {
    "lockstep/qp12": lockstep("qp12", "hoap3"),
    "lockstep/stable_qp": lockstep("stable_qp", "ur5"),
    "lockstep/tsid": lockstep("tsid", "ur5"),
    "lockstep/ghc_force": lockstep("ghc_force", "lwr_with_table"),
    "lockstep/clik_sdp": lockstep("clik_sdp_ur5", "ur5", "emulator.posture=outstretched"),
    "lockstep/standing": lockstep("tsid_standing", "hoap3_standing_torque"),
    "lockstep/late": lockstep("qp12", "hoap3", *LATE),
    "lockstep/delayed": lockstep("stable_qp", "ur5", "emulator.delay_ticks=3"),
    "realtime/misses": None,
    "realtime/stalls": None,
    **dict.fromkeys(f"damaged/{name}" for name in DAMAGES),
}
"""Logs that the old revision makes and both read; those without a command are made by `logs.py`."""


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


def scripts() -> list[Case]:
    """Runs in which changes, targets or misses come at given ticks; each file of `inputs`."""
    script = str(Path(__file__).with_name("simulate.py"))
    return [
        Case(f"scripts/{path.stem}", (Step("simulate", (script, str(path))),), path.stem in QUICK)
        for path in sorted(INPUTS.glob("*.json"))
    ]


def settings() -> list[Case]:
    """Delays, late answers, and bodies in MuJoCo."""
    mujoco = "emulator.plant.kind=mujoco"
    runs = {
        "delay_1": lockstep("qp12", "hoap3", "emulator.delay_ticks=1"),
        "delay_3": lockstep("stable_qp", "ur5", "emulator.delay_ticks=3"),
        "late": lockstep("qp12", "hoap3", *LATE),
        "late_extrapolated": lockstep(
            "stable_qp", "ur5", *LATE, "emulator.loss_policy=extrapolate"
        ),
        "late_accelerations": lockstep("tsid", "ur5", *LATE),
        "encoder_counts": lockstep("qp12", "hoap3", "emulator.plant.encoder=counts"),
        "mujoco_one_foot": lockstep("stable_qp", "hoap3_one_foot"),
        "mujoco_ur5": lockstep("stable_qp", "ur5", mujoco),
        "mujoco_lwr_torque": lockstep("ghc_torque", "lwr", mujoco, "emulator.command=torque"),
    }
    return [Case(f"settings/{name}", (step,), name in QUICK) for name, step in runs.items()]


TCP_IGNORED = (
    ("log/controller.mcap:*stamp*", "wall clock of the controller's process"),
    ("log/controller.mcap:*.log_time", "wall clock of the controller's process"),
    ("log/controller.mcap:events.*", "depend on when the controller's process is ended"),
    ("log/controller.mcap:inputs.*", "hold its wall clock and its process"),
    ("log/*.mcap:*session_id", "random where a process has no seed"),
)


def tcp() -> list[Case]:
    """HOAP-3's own protocol between two processes on virtual time."""
    cases = []
    for order, first in (("paper", "robot_first"), ("legacy", "controller_first")):
        keys = (
            "kind=hoap3_tcp",
            *(
                f"hoap3_tcp.{key}"
                for key in (f"order={order}", "init_port={port0}", "control_port={port1}")
            ),
        )
        link = ("--out", "log", *(word for key in keys for word in ("--set", f"link.{key}")))
        robot = "hoap3", "emulator", "hoap3", "--lockstep", "--duration", SECONDS, "--json", *link
        steps = (
            Step(
                "controller",
                ("hoap3", "controller", "qp12", "--no-realtime", *link),
                background=True,
            ),
            Step("emulator", (*robot, "--no-realtime")),
        )
        cases.append(Case(f"tcp/{first}", steps, ignored=TCP_IGNORED))
    return cases


def analyses() -> list[Case]:
    """Everything that reads a log, over each log that the old revision has made."""
    cases = []
    for name in LOGS:
        log = f"{{logs}}/{name}/log"
        steps = (
            Step("report", ("hoap3", "report", log, "--json", "--out", "report.html")),
            Step("verify", ("hoap3", "verify", log, "--json")),
            Step("replay", ("hoap3", "replay", log, "--json")),
            Step("export", ("hoap3", "export", log, "--to", "robot.csv")),
            Step("export_npz", ("hoap3", "export", log, "--to", "robot.npz")),
            Step("export_law", ("hoap3", "export", log, "--to", "law.npz", "--side", "controller")),
            Step("compare", ("hoap3", "compare", "qp12", "pinv", "--log", log, *COMPARE)),
        )
        cases.append(Case(f"logs/{name}", steps, name in QUICK, logs=(name,)))
    return cases


def comparisons() -> list[Case]:
    """Controllers in closed loop."""
    runs = {
        "velocities": ("qp12", "pinv", "stable_qp@psi.beta=20"),
        "arms": ("qp12", "tsid", "clik_sdp", "--robot", "ur5"),
    }
    return [
        Case(
            f"compare/{name}",
            (Step("compare", ("hoap3", "compare", *words, "--duration", "2", *COMPARE)),),
        )
        for name, words in runs.items()
    ]


def all_cases() -> list[Case]:
    """Every case."""
    return [*pairs(), *scripts(), *settings(), *tcp(), *comparisons(), *analyses()]
