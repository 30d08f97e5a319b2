"""Runs of the arm in lockstep: the shipped controllers on the emulator's rigid body.

The arm is `lwr` without the ends of its joints' ranges, and free to accelerate: the paper names
limits of speeds and torques only, and in 2 ▷ 1 ▷ 3 its targets bend joint 4 further than the real
arm can. One step of integration a period, as controllers at 1 kHz see the arm.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.simulate import Simulation, simulate

ROBOT = "lwr"
END_S = 0.5  # of a phase, over which its errors are averaged: some rest in small oscillations
FAR, FAST, QUICK = 100.0, 10.0, 2000.0  # rad, rad/s, rad/s²: of the arm without ends
NO_BOUNDS = {"kind": "none"}


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, one row a tick.

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

    def end(self, phase: int, phase_s: float = ref.PHASE_S) -> slice:
        """Ticks of the last `END_S` of a phase."""
        return self.rows((phase + 1) * phase_s - END_S, (phase + 1) * phase_s)

    def rest(self, phase: int, task: str) -> float:
        """Error of a task at the end of a phase, its mean there."""
        return float(self.errors[task][self.end(phase)].mean())

    def restlessness(self, phase: int) -> float:
        """Root mean square of |dq| at the end of a phase [rad/s]."""
        return float(np.sqrt((self.dq[self.end(phase)] ** 2).sum(axis=1).mean()))


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
    limits = {
        "lower": -FAR,
        "upper": FAR,
        "velocity": FAST,
        "brake_acceleration": QUICK,
        "setpoint_acceleration_max": QUICK,
    }
    content = {
        "name": f"{ROBOT}_without_ends",
        "urdf": "arm.urdf",
        "joints": [{"name": name, **limits} for name in robot.joint_names],
        "postures": {ref.START: [float(each) for each in robot.postures[ref.START]]},
        "initial_posture": ref.START,
        "period_s": robot.period_s,
        "command_kinds": ["torque"],
        "base_frame": robot.base_frame,
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return str(path)


def follow(
    controller: str,
    parameters: Mapping[str, Any],
    seconds: float,
    *,
    gravity: str = "none",
    ends: bool = False,
) -> Run:
    """One run.

    Args:
        controller: `ghc`, `hqp` or `weighted`.
        parameters: its own.
        seconds: how long.
        gravity: of the emulator's plant: none or full.
        ends: whether the joints' ranges are the real arm's.
    """
    plant = {"gravity": gravity, "substeps": 1}
    with tempfile.TemporaryDirectory() as folder:
        name = ROBOT if ends else free_arm(Path(folder))
        robot = {"robot": name, "posture": ref.START, "command": "torque", "plant": plant}
        paper = {"null_damping_per_s": 0.0}  # its (12) and (13) have no task but those named
        config = {"controller": controller, "parameters": {**paper, **parameters}}
        return run_of(simulate(robot, config, seconds))


def position(
    name: str, target: Mapping[str, Any], gains: tuple[float, float] = ref.STATIC
) -> dict[str, Any]:
    """The task that brings hand or elbow to a target."""
    frame = {ref.HAND: "ee", ref.ELBOW: "elbow"}[name]
    kp, kd = gains
    parameters = {"frame": frame, "target": dict(target)}
    return {"name": name, "task": "frame_position", "kp": kp, "kd": kd, "parameters": parameters}


def point(place: tuple[float, float, float]) -> dict[str, Any]:
    """A target that stands."""
    return {"kind": "point", "position_m": list(place)}


def three_tasks(hand: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Hand, elbow and posture, with targets that contradict each other."""
    kp, kd = ref.STATIC
    return [
        hand or position(ref.HAND, point(ref.HAND_M)),
        position(ref.ELBOW, point(ref.ELBOW_M)),
        {"name": ref.POSTURE, "task": "posture", "kp": kp, "kd": kd}
        | {"parameters": {"posture": ref.START}},
    ]


def priorities(over_s: float, seconds: float, phase_s: float = ref.PHASE_S) -> dict[str, Any]:
    """The hierarchies of `PHASES`, of `phase_s` each, with transitions of `over_s`."""
    down = [ref.HAND, ref.ELBOW, ref.POSTURE]
    changes: list[dict[str, Any]] = [
        {"at_s": 1.0 * phase_s, "order": down, "over_s": over_s},
        {"at_s": 2.0 * phase_s, "order": [ref.ELBOW, ref.HAND, ref.POSTURE], "over_s": over_s},
        {"at_s": 3.0 * phase_s, "remove": ref.ELBOW, "over_s": over_s},
        {"at_s": 3.5 * phase_s, "order": down},  # for when the elbow takes part again
        {"at_s": 4.0 * phase_s, "insert": ref.ELBOW, "over_s": over_s},
    ]
    timeline = [change for change in changes if change["at_s"] < seconds]
    return {"order": down[::-1], "timeline": timeline}


def switching(
    controller: str,
    over_s: float,
    seconds: float = ref.PHASE_S * len(ref.PHASES),
    *,
    gravity: str = "none",
    ends: bool = False,
    **parameters: Any,
) -> Run:
    """Targets that stand, and hierarchies that change; `parameters` are added to those."""
    given: dict[str, Any] = {
        "tasks": three_tasks(),
        "priorities": priorities(over_s, seconds),
        "w_r": ref.W_R,
        "bounds": NO_BOUNDS,
        **({"regularise": "torque"} if controller == "ghc" else {}),
        **parameters,
    }
    return follow(controller, given, seconds, gravity=gravity, ends=ends)
