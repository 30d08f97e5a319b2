"""Runs of the arm in lockstep: the shipped controllers on the emulator's rigid body.

The arm is `lwr` without the ends of its joints' ranges, and free to accelerate: the paper names
limits of speeds and torques only, and in 2 ▷ 1 ▷ 3 its targets bend joint 4 further than the real
arm can. One step of integration a period, as controllers at 1 kHz see the arm.

The paper prints neither targets nor start nor the robot's inertia. Ours were fitted until the
errors that contradicting tasks leave were those of its Table 1, GHC. For the lemniscate it prints
the period, 2π s, the gains and both bounds; amplitude, centre and plane are ours, and bounds of
accelerations are those that keep a joint able to keep its speed for ten periods. For Figs. 9 and 10
it prints no place, no force and no law of contact: ours is the shipped config `ghc_force` on
`lwr_with_table`, K = 2·10⁴ N/m, with an elbow target that keeps the hand above the plane until
priorities change. The measured wrench is in the equation of motion, and task 1a, the horizontal
position, and 1b, the force, are one task of three rows.
"""

from __future__ import annotations

import copy
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hoap3.remote_controller.config import read_config
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.report.motion import point_path
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers import Say
from hoap3.tools.services.simulate import Simulation, simulate

ROBOT = "lwr"
END_S = 0.5  # of a phase, over which its errors are averaged: some rest in small oscillations
FAR, FAST, QUICK = 100.0, 10.0, 2000.0  # rad, rad/s, rad/s²: of the arm without ends
NO_BOUNDS = {"kind": "none"}

HAND, ELBOW, POSTURE = TASKS = ("hand", "elbow", "posture")
"""Tasks 1, 2 and 3."""

PHASES = ("3 ▷ 2 ▷ 1", "1 ▷ 2 ▷ 3", "2 ▷ 1 ▷ 3", "1 ▷ 3", "1 ▷ 2 ▷ 3 again")
"""Hierarchies one after the other."""

HIGHEST = (POSTURE, HAND, ELBOW, HAND, HAND)
"""The task above all others, by phase."""

HAND_M = (0.0783, -0.5129, 0.302)
ELBOW_M = (0.18689, 0.28125, 0.5249)
START = "table1"
"""Targets of hand and elbow, and the posture, where the arm also starts. Not in the paper."""

W_R = 0.01
STATIC, TRACKING = (30.0, 20.0), (100.0, 20.0)
"""kp [1/s²] and kd [1/s] for a target that stands, and for one that moves."""

SPEED_MAX, TORQUE_MAX = 1.2, 1.5
"""Bounds of Fig. 8 [rad/s, N m]."""

COMPROMISES = (0.0, 0.2, 0.5, 0.8, 1.0)
"""α₁₂ of Fig. 11, and its ends."""

FORCE_N = 10.0
"""Desired force of Figs. 9 and 10. Not in the paper, which shows a curve."""

PHASE_S = 8.0
"""How long each hierarchy lasts."""

FAST_S, SLOW_S, LEMNISCATE_S = 0.005, 2.0, 2.0
"""Durations of transitions in Figs. 3, 4 and 7."""

HQP_DAMPING = 1e-3
HALF_WIDTH_M, CENTER_M = 0.10, (-0.45, 0.15, 0.75)
PERIOD_S = 2.0 * math.pi
APPROACH_S = 1.0
BOUNDS: dict[str, Any] = {
    "kind": "viability",
    "horizon_periods": 10.0,
    "acceleration_max": [100.0],
    "speed_max": [SPEED_MAX],
    "torque_max": [TORQUE_MAX],
    "speed_share": 1.0,
    "acceleration_share": 1.0,
    "brake_share": 1.0,
    "margin_rad": 0.0,
}

SWITCH_S, OVER_S, SECONDS = 2.0, 1.0, 10.0
"""Figs. 9 and 10: when priorities change, over which time, and the end."""

ELBOW_TARGET_M = (0.0684, -0.1368, 0.68)
COMPROMISE_S = 8.0


@dataclass(frozen=True, eq=False)
class Run:
    """One run, one row a tick.

    Attributes:
        period_s: between two rows.
        errors: |e| by the task's name, (N,) [m or rad].
        alpha: the matrix of priorities, (N, k, k); empty where there is none.
        q, dq: (N, n) [rad, rad/s].
        tau: commanded torques, (N, n) [N m].
        force: along the normal where there is one, (N,) [N].
        fallbacks: ticks without an answer within all bounds.
    """

    period_s: float
    errors: Mapping[str, Array]
    alpha: Array
    q: Array
    dq: Array
    tau: Array
    force: Array
    fallbacks: int

    @property
    def time_s(self) -> Array:
        """Since the start."""
        return np.arange(len(self.q), dtype=np.float64) * self.period_s

    @cached_property
    def jerk(self) -> Array:
        """Σ_i ∫ |d³q_i/dt³| dt up to each tick, (N,) [rad/s²]."""
        ddq = np.diff(self.dq, axis=0, prepend=self.dq[:1]) / self.period_s
        changes = np.abs(np.diff(ddq, axis=0, prepend=ddq[:1])).sum(axis=1)
        found: Array = np.cumsum(changes)
        return found

    def rows(self, start_s: float, end_s: float) -> slice:
        """Ticks of a time."""
        return slice(round(start_s / self.period_s), round(end_s / self.period_s))

    def rest(self, phase: int, task: str) -> float:
        """Error of a task at the end of a phase, its mean over the last `END_S`."""
        end = self.rows((phase + 1) * PHASE_S - END_S, (phase + 1) * PHASE_S)
        return float(self.errors[task][end].mean())


def run_of(done: Simulation) -> Run:
    """The columns of a simulation, without its brake to rest."""
    ticks, names = len(done.setpoints), list(done.controller.extra_names)
    extra, states = done.setpoints["extra"], done.states[: len(done.setpoints)]
    columns = {name: extra[:, place].copy() for place, name in enumerate(names)}
    errors = {name[6:]: values for name, values in columns.items() if name.startswith("error_")}
    alpha = [values for name, values in columns.items() if name.startswith("alpha_")]
    forces = [values for name, values in columns.items() if name.startswith("force_")]
    k = len(errors) if alpha else 0
    return Run(
        done.controller.description.period_s,
        errors,
        np.array(alpha).T.reshape(ticks, k, k),
        states["q"].copy(),
        states["dq"].copy(),
        done.setpoints["values"].copy(),
        forces[0] if forces else np.zeros(0),
        int((done.setpoints["fallback"] != 0).sum()),
    )


def free_arm(folder: Path) -> str:
    """Write the arm without ends of its ranges; its file."""
    robot = load(ROBOT)
    (folder / "arm.urdf").write_text(robot.urdf, encoding="utf-8")
    limits = {"lower": -FAR, "upper": FAR, "velocity": FAST}
    limits |= dict.fromkeys(("brake_acceleration", "setpoint_acceleration_max"), QUICK)
    content = {
        "name": f"{ROBOT}_without_ends",
        "urdf": "arm.urdf",
        "joints": [{"name": name, **limits} for name in robot.joint_names],
        "postures": {START: [float(each) for each in robot.postures[START]]},
        "initial_posture": START,
        "period_s": robot.period_s,
        "command_kinds": ["torque"],
        "base_frame": robot.base_frame,
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return str(path)


def follow(controller: str, parameters: Mapping[str, Any], seconds: float) -> Run:
    """One run of `ghc` or `hqp`, without gravity."""
    plant = {"gravity": "none", "substeps": 1}
    with tempfile.TemporaryDirectory() as folder:
        name = free_arm(Path(folder))
        robot = {"robot": name, "posture": START, "command": "torque", "plant": plant}
        paper = {"null_damping_per_s": 0.0}  # its (12) and (13) have no task but those named
        config = {"controller": controller, "parameters": {**paper, **parameters}}
        return run_of(simulate(robot, config, seconds))


def position(
    name: str, target: Mapping[str, Any], gains: tuple[float, float] = STATIC
) -> dict[str, Any]:
    """The task that brings hand or elbow to a target."""
    frame = {HAND: "ee", ELBOW: "elbow"}[name]
    kp, kd = gains
    parameters = {"frame": frame, "target": dict(target)}
    return {"name": name, "task": "frame_position", "kp": kp, "kd": kd, "parameters": parameters}


def point(place: tuple[float, float, float]) -> dict[str, Any]:
    """A target that stands."""
    return {"kind": "point", "position_m": list(place)}


def three_tasks(hand: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Hand, elbow and posture, with targets that contradict each other."""
    kp, kd = STATIC
    return [
        hand or position(HAND, point(HAND_M)),
        position(ELBOW, point(ELBOW_M)),
        {"name": POSTURE, "task": "posture", "kp": kp, "kd": kd}
        | {"parameters": {"posture": START}},
    ]


def priorities(over_s: float, seconds: float) -> dict[str, Any]:
    """The hierarchies of `PHASES`, of `PHASE_S` each, with transitions of `over_s`."""
    down, phase_s = [HAND, ELBOW, POSTURE], PHASE_S
    changes: list[dict[str, Any]] = [
        {"at_s": 1.0 * phase_s, "order": down, "over_s": over_s},
        {"at_s": 2.0 * phase_s, "order": [ELBOW, HAND, POSTURE], "over_s": over_s},
        {"at_s": 3.0 * phase_s, "remove": ELBOW, "over_s": over_s},
        {"at_s": 3.5 * phase_s, "order": down},  # for when the elbow takes part again
        {"at_s": 4.0 * phase_s, "insert": ELBOW, "over_s": over_s},
    ]
    timeline = [change for change in changes if change["at_s"] < seconds]
    return {"order": down[::-1], "timeline": timeline}


def switching(
    controller: str, over_s: float, seconds: float = PHASE_S * len(PHASES), **parameters: Any
) -> Run:
    """Targets that stand, and hierarchies that change; `parameters` are added to those."""
    given: dict[str, Any] = {
        "tasks": three_tasks(),
        "priorities": priorities(over_s, seconds),
        "w_r": W_R,
        "bounds": NO_BOUNDS,
        **({"regularise": "torque"} if controller == "ghc" else {}),
        **parameters,
    }
    return follow(controller, given, seconds)


def track(seconds: float = PHASE_S * len(PHASES)) -> Run:
    """The hand on the lemniscate, within bounds, and hierarchies that change."""
    target = {
        "kind": "lemniscate",
        "half_width_m": HALF_WIDTH_M,
        "center_m": list(CENTER_M),
        "plane": "xy",
        "period_s": PERIOD_S,
        "approach_s": APPROACH_S,
    }
    tasks = three_tasks(position(HAND, target, TRACKING))
    return switching("ghc", LEMNISCATE_S, seconds, tasks=tasks, bounds=BOUNDS)


def press(seconds: float = SECONDS, switch_s: float = SWITCH_S) -> Run:
    """2 ▷ 1 ▷ 3 ⇒ 1 ▷ 2 ▷ 3."""
    content, _ = read_config("ghc_force")
    config = copy.deepcopy(content)
    tasks = {task["name"]: task["parameters"] for task in config["parameters"]["tasks"]}
    tasks[HAND]["force_n"] = FORCE_N
    tasks[ELBOW]["target"]["position_m"] = list(ELBOW_TARGET_M)
    change = {"at_s": switch_s, "order": [HAND, ELBOW, POSTURE], "over_s": OVER_S}
    start = {"order": [ELBOW, HAND, POSTURE], "timeline": [change]}
    config["parameters"]["priorities"] = start
    return run_of(simulate("lwr_with_table", config, seconds))


def compromise(alpha: float, seconds: float = COMPROMISE_S) -> tuple[float, float]:
    """Errors of hand and elbow with α₁₂ and α₂₁ = 1 − α₁₂ [m], means over the last half second.

    The arm is not at rest there, since two position tasks leave one joint motion free.
    """
    given = {
        "tasks": [position(HAND, point(HAND_M)), position(ELBOW, point(ELBOW_M))],
        "priorities": {"matrix": [[0.0, alpha], [1.0 - alpha, 0.0]]},
        "w_r": W_R,
        "regularise": "torque",
        "bounds": NO_BOUNDS,
    }
    run = follow("ghc", given, seconds)
    last = slice(-round(END_S / run.period_s), None)
    hand, elbow = (float(run.errors[name][last].mean()) for name in (HAND, ELBOW))
    return hand, elbow


def hand_path(q: Array) -> Array:
    """Where the hand is, (N, 3) [m], for positions of the joints, (N, n)."""
    return point_path(np.ascontiguousarray(q), load(ROBOT), "ee", "base")


@dataclass(frozen=True)
class Runs:
    """All runs but those of Fig. 12.

    Attributes:
        hqp, fast, slow: of Figs. 2, 3 and 4.
        lemniscate: of Figs. 6 to 8.
        pressing: of Fig. 10.
        compromises: errors of hand and elbow by α₁₂ [m], Fig. 11.
    """

    hqp: Run
    fast: Run
    slow: Run
    lemniscate: Run
    pressing: Run
    compromises: Mapping[float, tuple[float, float]]

    @property
    def tabled(self) -> dict[str, Run]:
        """Those of Table 1, by name."""
        return {"HQP": self.hqp, "GHC, 5 ms": self.fast, "GHC, 2 s": self.slow}


def run_all(say: Say) -> Runs:
    """Every run that a figure or a row shows."""
    say(f"Table 1: GHC, transitions of {FAST_S:g} s and {SLOW_S:g} s")
    fast, slow = switching("ghc", FAST_S), switching("ghc", SLOW_S)
    say("Table 1: HQP")
    hqp = switching("hqp", 0.0, w_r=HQP_DAMPING)
    say("Figs. 6 to 8: the lemniscate")
    lemniscate = track()
    say("Figs. 9 and 10: pressing on a plane")
    pressing = press()
    say("Fig. 11: two tasks without strict priority")
    compromises = {alpha: compromise(alpha) for alpha in COMPROMISES}
    return Runs(hqp, fast, slow, lemniscate, pressing, compromises)
