"""Runs of HOAP-3 in lockstep, and what the pictures take from them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.services.simulate import Simulation, simulate

POINTS = 240  # of a curve at the most
TARGET = (0.01, 0.025, 0.2869)  # m, of the centre of mass in the right sole's frame: the paper's
SPEEDS = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.6}}
WITHIN = ({**SPEEDS}, {"constraint": "joint_position"})
EDGE = {"constraint": "support_polygon", "parameters": {"margin_m": 0.005}}

JOINTS = load("hoap3").joint_names
BEGAN = Event.schema.constants["CONDITION_BEGAN"]
ENDED = Event.schema.constants["CONDITION_ENDED"]
Array = np.ndarray[Any, np.dtype[np.float64]]


def to(*position_m: float, frame: str = "r_sole") -> dict[str, Any]:
    """The task that brings the centre of mass to a point."""
    target = {"kind": "point", "position_m": list(position_m)}
    return {"task": "com", "parameters": {"frame": frame, "target": target}}


def reach(frame: str, *position_m: float, reference: str = "pelvis") -> dict[str, Any]:
    """The task that brings the origin of a frame to a point."""
    target = {"kind": "point", "position_m": list(position_m)}
    parameters = {"frame": frame, "reference": reference, "target": target}
    return {"task": "frame_position", "parameters": parameters}


def qp12(gamma: float) -> dict[str, Any]:
    """Φ = γ|u|₁ + (1−γ)/2·|u|₂²."""
    return {"kind": "qp12", "gamma": gamma}


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, by tick."""

    simulation: Simulation

    @property
    def time(self) -> Array:
        """Of each answer [s]."""
        return np.asarray(self.simulation.setpoints["tick"] * 1e-3)

    @cached_property
    def q(self) -> Array:
        """What the robot applied, (ticks, n) [rad]."""
        ticks = self.simulation.setpoints["tick"]
        return np.asarray(self.simulation.states["reference"])[ticks]

    @cached_property
    def u(self) -> Array:
        """Joint velocities, (ticks, n) [rad/s]."""
        return np.asarray((self.simulation.setpoints["values"] - self.q) / 1e-3)

    def __getitem__(self, field: str) -> Array:
        """A field of the setpoints."""
        return np.asarray(self.simulation.setpoints[field])

    def com(self, frame: str = "r_sole") -> Array:
        """Centre of mass seen from a frame, (ticks, 3) [m]."""
        kinematics, position = Kinematics(load("hoap3")), np.zeros(3)
        jacobian, found = np.zeros((3, self.q.shape[1])), []
        for q in self.q:
            kinematics.update(q)
            kinematics.com(kinematics.frame_id(frame), position, jacobian)
            found.append(position.copy())
        return np.array(found)

    def frame(
        self, name: str, reference: str = "pelvis", *, at: tuple[float, float, float] = (0, 0, 0)
    ) -> Array:
        """A point that is fixed to a frame, seen from another, (ticks, 3) [m]."""
        kinematics, position = Kinematics(load("hoap3")), np.zeros(3)
        rotation, jacobian, found = np.zeros((3, 3)), np.zeros((6, self.q.shape[1])), []
        for q in self.q:
            kinematics.update(q)
            frames = kinematics.frame_id(name), kinematics.frame_id(reference)
            kinematics.frame(*frames, position, rotation, jacobian)
            found.append(position + rotation @ np.array(at))
        return np.array(found)

    def conditions(self) -> list[tuple[float, str, bool]]:
        """Time [s], name, and whether it began or ended, in order."""
        names: tuple[str, ...] = ()
        found, event = [], Event()
        for record in self.simulation.records:
            if record.kind == Kind.SESSION:
                names = tuple(json.loads(record.payload)["conditions"])
            elif record.kind == Kind.EVENT:
                event.load(record.payload)
                if event.kind in (BEGAN, ENDED):
                    found.append((event.tick * 1e-3, names[event.detail], event.kind == BEGAN))
        return found


def run(
    duration: float,
    task: Mapping[str, Any] | None = None,
    constraints: Iterable[Mapping[str, Any]] = (),
    **parameters: Any,
) -> Run:
    """`stable_qp` on HOAP-3 for `duration` [s], the paper's motion where nothing else is said."""
    settings = {"task": task or to(*TARGET), "constraints": list(constraints), **parameters}
    return Run(simulate("hoap3", {"controller": "stable_qp", "parameters": settings}, duration))
