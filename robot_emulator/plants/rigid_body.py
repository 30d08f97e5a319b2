"""A body whose joints take torques: articulated-body dynamics, friction, contacts, end stops."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.base import Declared, Plant
from hoap3.robot_emulator.plants.contact import Contacts

ROUNDING = 1e-9  # of an effort: a torque that exceeds it by no more was meant to be it
SLIDING = 0.01  # rad/s or m/s: above it friction is Coulomb's, below it grows in proportion


class RigidBody(Plant):
    """Forward dynamics by Pinocchio's articulated-body algorithm, semi-implicit Euler.

    Each period has `substeps` steps of h: dq ← dq + h·ddq, then q ← q + h·dq. Friction is that of
    the URDF, viscous and Coulomb, τ_f = (d + c / max(|dq|, `SLIDING`))·dq, taken at the new
    velocity, so that no friction, however strong, makes it shake: with B = d + c / max(…),

        (M + hB)·ddq = τ − h(q, dq) − B·dq

    A joint in rest under less than c creeps at `SLIDING`·τ/c. A joint that runs into a mechanical
    stop stays there, without rebound. Torques are cut to the efforts of the description.

    Contacts act in each of these steps, at the velocities after it (`contact`). While the brakes
    are on they press as they do at rest, without friction.

    Gravity is the description's: `compensated` means that the robot adds its torque to every
    command, within the efforts.

    Attributes:
        q, dq: positions and velocities.
        tau: torques of the motors, all told; at rest with the brakes on, what these carry.
        wrench: of contacts on each wrench sensor (6 per sensor), mean over the last period, so
            that it holds the whole impulse of an impact; see `Contacts.feel`.

    Raises:
        DescriptionError: a joint moves nothing that weighs.
    """

    commands = ("torque",)
    heeds = ("friction", "substeps", "contacts")

    def __init__(self, description: RobotDescription, settings: PlantSettings) -> None:
        from hoap3.robot_emulator.plants import motion_kernels as kernels

        super().__init__(description, settings)
        self.torque_model = self
        n = description.n
        self._advance, self._joint_friction = kernels.advance, kernels.joint_friction
        self._clamp = kernels.clamp
        self._dynamics = Dynamics(description)
        self._dynamics.check_forward(description.initial_position)
        self._substeps = settings.substeps
        self._effort, self._least = np.array(description.effort), -description.effort
        self._beyond = (1.0 + ROUNDING) * self._least, (1.0 + ROUNDING) * self._effort
        self._stops = np.array(description.lower_hard), np.array(description.upper_hard)
        self._compensated = description.gravity == "compensated"
        self._viscous = self._dynamics.damping if settings.friction else np.zeros(n)
        self._coulomb = self._dynamics.friction if settings.friction else np.zeros(n)
        self._net, self._ddq, self._added, self._weight, self._needed = np.zeros((5, n))
        self._slope, self._asked, self._idle, self._none, self._after = np.zeros((5, n))
        contacts = settings.contacts
        self._contacts = Contacts(description, contacts, self._dynamics) if contacts else None

    @classmethod
    def configured(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any, seed: int
    ) -> Self:
        """Make one of the keys of `plant`."""
        del parameters, seed
        return cls(description, settings)

    @classmethod
    def of_another(
        cls, description: RobotDescription, settings: PlantSettings, plant: Plant
    ) -> Self:
        """What torques do to another plant, by this model, where that one measures itself to be."""
        model = cls(description, settings.model_copy(update={"contacts": ()}))
        model.q, model.dq = plant.q, plant.dq
        return model

    @classmethod
    def declare(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any
    ) -> Declared:
        """Refuse contacts of frames that the robot does not have, or does not move."""
        del parameters
        for number, contact in enumerate(settings.contacts):
            key, frame = f"contacts.{number}.frame", contact.frame
            if frame not in description.frames:
                listing = one_of(frame, sorted(description.frames), "Its frames")
                problem = f"robot {description.name!r} has no such frame"
                raise ConfigError("", key, frame, problem, listing)
            if frame not in description.structure.moving:
                moving = ", ".join(sorted(description.structure.moving))
                remedy = f"Those that move: {moving}"
                raise ConfigError("", key, frame, "no joint moves it", remedy)
        return Declared()

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m]."""
        self.q[:] = self.start[:] = q
        self.hold(0.0)

    def step(self, command: FloatArray, dt: float) -> None:
        """Move under the torques `command`, (n,) [N m or N], for `dt` [s]."""
        h = dt / self._substeps
        self.wrench[:] = 0.0
        for _ in range(self._substeps):
            self._forward(command, h)
            if self._contacts:
                self._contacts.feel(1.0 / self._substeps, self.wrench)
            self._advance(self._ddq, h, False, *self._stops, self.q, self.dq)

    def hold(self, dt: float) -> None:
        """Stand still: the brakes hold it, and stop it at once where it still moves."""
        del dt
        self.dq[:] = 0.0
        self._dynamics.gravity(self.q, self.tau)
        if self._contacts:
            self.tau -= self._contacts.torques(self.q, self.dq, 0.0)
            self.wrench[:] = 0.0
            self._contacts.feel(1.0, self.wrench)

    def accelerations(self, command: FloatArray, dt: float, out: FloatArray) -> int:
        """Write what torques, (n,), would give over `dt` [s], (n,) [rad/s² or m/s²].

        Returns:
            The number of the first joint whose torque is beyond its effort, or -1.
        """
        self._forward(command, dt)
        out[:] = self._ddq
        return int(self._clamp(self._asked, *self._beyond, self._needed))

    def torques(self, ddq: FloatArray, dt: float, out: FloatArray) -> int:
        """Write the command, (n,), that accelerations need over `dt` [s], as far as efforts allow.

        Joints whose efforts suffice get theirs beside others that lack the efforts.

        Returns:
            The number of the first joint whose effort is too small, or -1.
        """
        self._need(ddq, dt, self._needed)
        short: int = self._clamp(self._needed, self._least, self._effort, out)
        if short >= 0:
            self._make_up(dt, out)
        if self._compensated:
            self._dynamics.gravity(self.q, self._weight)
            out -= self._weight
        return short

    def _make_up(self, dt: float, out: FloatArray) -> None:
        """Let joints keep their accelerations beside others that lack the efforts for theirs.

        With the torques τ_S of these fixed, their ddq miss δ_S, M_SS·δ_S = τ_S − needed_S, and the
        others need M_·S·δ_S besides. Whoever lacks that joins S.
        """
        mass = self._dynamics.mass(self.q)
        mass[np.diag_indices_from(mass)] += dt * self._slope
        short = out != self._needed
        while True:
            lacking = (out - self._needed)[short]
            beside = self._needed + mass[:, short] @ np.linalg.solve(
                mass[np.ix_(short, short)], lacking
            )
            cut = np.clip(beside, self._least, self._effort)
            out[~short] = cut[~short]
            more = (cut != beside) & ~short
            if not more.any():
                return
            short |= more

    def share(self, ddq: FloatArray, dt: float) -> float:
        """How much of accelerations, (n,), the efforts suffice for over `dt` [s], all joints alike.

        Returns:
            The largest share, 0 to 1; -1 where they do not even suffice for no acceleration.
        """
        idle, change = self._idle, self._needed
        self._need(self._none, dt, idle)
        self._need(ddq, dt, change)
        change -= idle
        room = np.where(change < 0.0, self._effort + idle, self._effort - idle)
        if (np.abs(idle) > self._effort).any():
            return -1.0
        needs = np.abs(change)
        return float(np.min(room / np.maximum(needs, room), initial=1.0, where=needs > 0.0))

    def _need(self, ddq: FloatArray, dt: float, out: FloatArray) -> None:
        """Write the torques of the motors that accelerations need over `dt` [s]."""
        self._dynamics.inverse(self.q, self.dq, ddq, out)
        self._joint_friction(self.dq, self._viscous, self._coulomb, SLIDING, self._added, self._net)
        out -= self._net
        np.copyto(self._slope, self._added)
        self._added *= dt
        self._added *= ddq
        out += self._added
        if self._contacts:
            np.multiply(ddq, dt, out=self._after)
            self._after += self.dq
            out -= self._contacts.torques(self.q, self._after, dt)

    def _forward(self, command: FloatArray, h: float) -> None:
        """Accelerations of a step of `h` [s] under a command, and the torques of the motors."""
        np.copyto(self._asked, command)
        if self._compensated:
            self._dynamics.gravity(self.q, self._weight)
            self._asked += self._weight
        self._clamp(self._asked, self._least, self._effort, self.tau)
        self._joint_friction(self.dq, self._viscous, self._coulomb, SLIDING, self._added, self._net)
        self._net += self.tau
        self._added *= h
        self._dynamics.forward(self.q, self.dq, self._net, self._added, self._ddq)
        if self._contacts:
            self._contacts.push(self.q, self.dq, self._added, h, self._ddq)
