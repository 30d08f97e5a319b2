"""A robot's body in MuJoCo, driven by servos, accelerations or torques."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Self

import numpy as np

from hoap3.protocol.errors import ConfigError, DescriptionError, SolverError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.base import Declared, Plant
from hoap3.robot_emulator.plants.mujoco.balance import Balance
from hoap3.robot_emulator.plants.mujoco.differences import differences, sunk
from hoap3.robot_emulator.plants.mujoco.equilibrium import place
from hoap3.robot_emulator.plants.mujoco.gains import Gains, servo_gains
from hoap3.robot_emulator.plants.mujoco.mjcf import check_base, refuse_unheeded
from hoap3.robot_emulator.plants.mujoco.model import MOTORS, SERVOS, build_model, mujoco_module
from hoap3.robot_emulator.plants.mujoco.rerooted_urdf import body_of
from hoap3.robot_emulator.plants.mujoco.senses import Encoders, Senses
from hoap3.robot_emulator.plants.mujoco.settings import (
    MujocoParameters,
    felt_soles,
    imu_frames_of,
    rotors_of,
)
from hoap3.robot_emulator.plants.mujoco.torques import ContactTorques

ROUNDING = 1e-9  # of an effort
FIRM = 1e-6  # of its weight: what nothing may have to hold at a start at rest


class MujocoPlant(Plant):
    """MuJoCo's dynamics and contacts, `implicitfast`, one or more steps a period.

    **Position** setpoints go to servos, τ = kp·(q* − q) − kv·dq. **Accelerations** become torques
    by inverse dynamics of the simulated model, at each step; only where the base is fixed.
    **Torques** are given as they are. All are cut to the efforts of the description. A robot that
    nobody commands is held by the servos where it was, as by brakes that give way.

    It starts in static equilibrium: with servos the reference is q + τ_g/kp.

    Attributes:
        start: that reference.
        tau: of the motors, servos and gravity compensation included.
    """

    commands = ("position", "acceleration", "torque")
    heeds = ("encoder",)
    kernels = ("hoap3.robot_emulator.plants.mujoco.contact_kernels",)

    class Parameters(MujocoParameters):
        """`plant.parameters`."""

    def __init__(
        self,
        description: RobotDescription,
        parameters: MujocoParameters,
        *,
        counts: bool = False,
        seed: int = 0,
    ) -> None:
        super().__init__(description, parameters)
        n, self._kind = description.n, description.command_kinds[0]
        self._mujoco, self._parameters = mujoco_module(), parameters
        self._description = description
        contacts, imus = felt_soles(description, parameters), imu_frames_of(description, parameters)
        soles = tuple(sole.frame for sole in description.soles)
        frames = dict.fromkeys((*soles, *contacts, *imus, *description.wrench_sensors))
        self.built = build_model(description, parameters, tuple(frames), imus)
        check_base(parameters, free=self.built.free, trees=len(self.built.trees))
        self.model = self.built.model
        self.data = self._mujoco.MjData(self.model)
        self._sole = soles[0] if soles else None
        self._pushes = [
            (
                self.model.body(body_of(push.frame)).id,
                push.at_s,
                push.at_s + push.for_s,
                push.force_n,
            )
            for push in parameters.pushes
        ]
        self._senses = Senses(self._mujoco, self.built, self.data, description, contacts, imus)
        scales = description.counts_per_rad if counts else None
        self._encoders = Encoders(n, scales, parameters.noise_rad, seed)
        self._sunk: list[str] = []
        self._place(description.initial_position)
        self.gains: Gains = servo_gains(
            self._mujoco, self.built, self.data, parameters, description
        )
        self._servos = np.arange(n) if self._kind == "position" else np.arange(1, 2 * n, 2)
        self._motors = np.arange(0, 2 * n, 2)
        self._set_gains()
        self.balance = Balance(self._mujoco, self.built, self.data, description, soles, contacts)
        self._true, self._held, self._sizes, self._driven = np.zeros((4, n))
        efforts = np.where(description.effort > 0.0, description.effort, np.inf)
        self._most, self._full = efforts * (1.0 - ROUNDING), np.zeros(n, np.bool_)
        self._wanted = np.zeros(self.model.nv)
        self._lifted = self.model.jnt_actgravcomp[self.model.dof_jntid[self.built.v_at]]
        self._step, self._braked = self._mujoco.mj_step, False
        if self._kind == "torque":
            self.torque_model = ContactTorques(
                self._mujoco,
                self.built,
                self.data,
                description.effort,
                self.tau,
                compensated=description.gravity == "compensated",
            )
        self._inverse = self._mujoco.mj_inverse

    @classmethod
    def configured(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any, seed: int
    ) -> Self:
        """Make one of its parameters, `encoder` and the seed."""
        return cls(description, parameters, counts=settings.encoder == "counts", seed=seed)

    @classmethod
    def declare(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any
    ) -> Declared:
        """Refuse frames that the robot lacks, accelerations of what may fall, keys of no use."""
        mujoco_module()
        refuse_unheeded(parameters)
        for number, push in enumerate(parameters.pushes):
            if push.frame not in description.frames and parameters.mjcf is None:
                key, hint = f"parameters.pushes.{number}.frame", "Its links"
                problem = f"robot {description.name!r} has no such link"
                known = one_of(push.frame, description.frames, hint)
                raise ConfigError("", key, push.frame, problem, known)
        if settings.encoder == "counts" and description.counts_per_rad is None:
            problem = f"robot {description.name!r} has no encoder scales"
            remedy = "Give each joint encoder_counts_per_rad, or write ideal"
            raise ConfigError("", "encoder", "counts", problem, remedy)
        for key in ("contact_frames", "imu_frames"):
            for number, frame in enumerate(getattr(parameters, key) or ()):
                if frame not in description.frames and parameters.mjcf is None:
                    place_of = f"parameters.{key}.{number}"
                    hint = one_of(frame, description.frames, "Its frames")
                    problem = f"robot {description.name!r} has no such frame"
                    raise ConfigError("", place_of, frame, problem, hint)
        if parameters.base == "free" and description.command_kinds[0] == "acceleration":
            remedy = "Write base: fixed, or command: torque or position"
            problem = "has no accelerations of its own: contacts decide about them"
            raise ConfigError("", "parameters.base", "free", problem, remedy)
        measures = Declared(
            base=13 if parameters.base == "free" else 0,
            contact=6 * len(felt_soles(description, parameters)),
            imu=10 * len(imu_frames_of(description, parameters)),
            armature=rotors_of(description, parameters),
        )
        if description.command_kinds[0] != "position":
            return measures
        made = cls(description, parameters)
        return replace(measures, servo_rate_1_s=made.gains.rate_limit)

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m], in static equilibrium where there is one."""
        torques = self._place(q) - self._compensation()
        self._senses.begin()
        np.divide(torques, self.gains.kp, out=self.start, where=self.gains.kp > 0.0)
        self.start += q
        if self._kind == "position":
            self.data.ctrl[:] = self.start
        else:
            self._brake(torques)
            self.start[:] = q
        self._mujoco.mj_forward(self.model, self.data)
        self._sunk = sunk(self.model, self.data)
        self._measure(0.0)

    def step(self, command: FloatArray, dt: float) -> None:
        """Follow `command`, (n,), for `dt` [s], which is the description's period."""
        data = self.data
        if self._kind == "position":
            data.ctrl[:] = command
            self._advance(dt)
            return
        if self._braked:
            self.model.opt.disableactuator = 1 << SERVOS
            self._braked = False
        if self._kind == "torque":
            data.ctrl[self._motors] = command
            self._advance(dt)
        else:
            np.matmul(self.built.ties.matrix, command, out=self._wanted)
            self._advance(dt, inverse=True)

    def hold(self, dt: float) -> None:
        """The servos hold it where it was when they were set."""
        if self._kind != "position" and not self._braked:
            self._brake(self.data.qfrc_actuator[self.built.v_at] - self._compensation())
        self._advance(dt)

    def notes(self) -> list[str]:
        """What MuJoCo simulates, and how fast a loop around its servos may be."""
        model, what = self.model, self._parameters
        size = f"{model.nv} degrees of freedom, {what.base} base"
        steps = f"{what.substeps} step(s) of {1e3 * model.opt.timestep:g} ms a period"
        said = [f"MuJoCo {self._mujoco.__version__}: {size}, {steps}"]
        if what.mjcf is not None:
            if self.built.actuators:
                ours = "the robot's own replace them, and controls of key frames are left out"
                said.append(f"{self.built.actuators} actuators of the MJCF file: {ours}")
            differs = "; ".join(differences(self._mujoco, self.built, self._description))
            if differs:
                said.append(f"the MJCF file is not of the robot that controllers know: {differs}")
        elif self.built.altered:
            listing = "; ".join(f"{body} {why}" for body, why in self.built.altered.items())
            said.append(f"inertias that MuJoCo does not take as they are: {listing}")
        if self._sunk:
            said.append(f"the start posture is inside what stands still: {'; '.join(self._sunk)}")
        if what.base == "free" and what.mjcf is not None and what.floor is None:
            said.append("no floor but what the MJCF file has")
        if self._unbalanced > FIRM:
            said.append(f"{self._unbalanced:.1%} of its weight is out of balance at the start")
        if self._kind == "position":
            said.append(
                f"a loop around these servos must be slower than {self.gains.rate_limit:.3g} 1/s "
                "in the start posture (`hoap3 help plants`)"
            )
        return said

    def summary(self) -> dict[str, Any]:
        """Where the simulated robot ended, beside what the model makes of its encoders."""
        return {
            "kind": "mujoco",
            "servo_rate_limit_1_s": self.gains.rate_limit if self._kind == "position" else None,
            **self.balance.summary(self.q),
            "warnings": self._warnings(),
        }

    def _warnings(self) -> dict[str, int]:
        """What MuJoCo complained about, and how often, such as a contact buffer that was full."""
        kinds = self._mujoco.mjtWarning
        counts = {kind.name: self.data.warning[kind.value].number for kind in _each(kinds)}
        return {name: int(count) for name, count in counts.items() if count}

    def _place(self, q: FloatArray) -> FloatArray:
        found = place(self._mujoco, self.built, self.data, q, self._parameters, self._sole)
        self._unbalanced = found.unbalanced
        if self._unbalanced > FIRM and self._parameters.mjcf is None:
            raise DescriptionError(
                f"robot {self._description.name!r} does not stand by itself in its start posture: "
                f"{found.unbalanced:.1%} of its weight is out of balance. Choose another posture, "
                "or write plant.parameters.position_m, and it begins to fall"
            )
        return found.torques

    def _set_gains(self) -> None:
        model, servos = self.model, self._servos
        model.actuator_gainprm[servos, 0] = self.gains.kp
        model.actuator_biasprm[servos, 1] = -self.gains.kp
        model.actuator_biasprm[servos, 2] = -self.gains.kv

    def _compensation(self) -> FloatArray:
        """What gravity compensation adds to servos and motors, (n,)."""
        return np.asarray(self.data.qfrc_gravcomp[self.built.v_at] * self._lifted)

    def _brake(self, torques: FloatArray) -> None:
        """Hold the joints by the servos where they are, under these torques of theirs."""
        held = self._held
        np.take(self.data.qpos, self.built.q_at, out=held)
        held += torques / self.gains.kp
        self.data.ctrl[self._motors] = 0.0
        self.data.ctrl[self._servos] = held
        self.model.opt.disableactuator = 1 << MOTORS
        self._braked = True

    def _advance(self, dt: float, *, inverse: bool = False) -> None:
        substeps, senses = self._parameters.substeps, self._senses
        senses.begin()
        for _ in range(substeps):
            if self._pushes:
                self._push()
            if inverse:
                self.data.qacc[:] = self._wanted
                self._inverse(self.model, self.data)
                np.matmul(self.data.qfrc_inverse, self.built.ties.matrix, out=self._driven)
                self._driven -= self._compensation()
                self.data.ctrl[self._motors] = self._driven
            self._step(self.model, self.data)
            if senses.feels:
                senses.feel(1.0 / substeps)
        self._measure(dt)

    def _push(self) -> None:
        """Have the forces from outside be those of this moment."""
        data, half = self.data, 0.5 * self.model.opt.timestep
        data.xfrc_applied[:] = 0.0
        for body, begin, end, force in self._pushes:
            if begin <= data.time + half < end:
                data.xfrc_applied[body, :3] += force

    def _measure(self, dt: float) -> None:
        data, built = self.data, self.built
        np.take(data.qpos, built.q_at, mode="clip", out=self._true)
        if not math.isfinite(float(self._true.sum())):
            raise SolverError(
                f"MuJoCo's state of robot {self._description.name!r} is not finite at {data.time:g}"
                " s: it is stiffer or lighter than a step can follow. Raise substeps or armature "
                "in plant.parameters, or lower kp"
            )
        if self._encoders.ideal or not dt:
            np.copyto(self.q, self._true)
            np.take(data.qvel, built.v_at, mode="clip", out=self.dq)
        else:
            self._encoders.read(self._true, dt, self.q, self.dq)
        np.take(data.qfrc_actuator, built.v_at, mode="clip", out=self.tau)
        np.abs(self.tau, out=self._sizes)
        np.greater_equal(self._sizes, self._most, out=self._full)
        self.saturated += bool(dt) and bool(self._full.any())
        self._senses.read(self.base, self.contact, self.wrench, self.imu)
        if dt:
            self.balance.look(self.contact)


def _each(kinds: Any) -> list[Any]:
    """Members of one of MuJoCo's enumerations, without the count at its end."""
    return [kind for name, kind in kinds.__members__.items() if not name.startswith("mjN")]
