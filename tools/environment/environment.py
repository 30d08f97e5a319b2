"""A robot as an environment: an agent gives setpoints, and sees States."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, NotInstalledError, UsageError, did_you_mean
from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.messages import COMMANDS, FloatArray, Setpoint, State
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.robot_emulator.robots import load_configured
from hoap3.robot_emulator.service import build_loop, describe
from hoap3.tools.services.configs import load_emulator_config

try:
    from gymnasium import Env
    from gymnasium.spaces import Box, Dict
except ImportError as error:
    raise NotInstalledError("package", "gymnasium", "'hoap3[gymnasium]'") from error

Observation = dict[str, FloatArray]

PER_JOINT = ("q", "dq", "tau", "reference", "reference_rate", "reference_acceleration")
SENSORS = ("wrench", "base", "contact", "imu")
MODES = ("idle", "active", "stopping", "stopped")
OPTIONS = ("posture", "q")
START = "start"  # what the posture of `options={"q": …}` is called in the description
MOST_SEEDS = 2**63


@dataclass(frozen=True)
class Transition:
    """One step, for the functions that judge it.

    Attributes:
        before, after: observations.
        action: as it was given, (n,); what the robot made of it is in `after["reference"]`.
        info: as `Environment.step` gives it.
    """

    before: Observation
    action: FloatArray
    after: Observation
    info: dict[str, Any]


class Environment(Env[dict[str, Any], FloatArray]):
    """A robot in lockstep, step by step, as a `gymnasium.Env`; needs the extra `hoap3[gymnasium]`.

    The loop, the link, the filter and the plant are those of `hoap3 run --lockstep`; setpoints come
    from `step` instead of a controller. No thread is started and no socket opened.

    An observation is a dict of new float64 arrays, with units rad or m, and s:
    `q`, `dq`, `tau` as measured, `reference`, `reference_rate`, `reference_acceleration` of the
    motion that the robot applies, (n,) each, in wire order; and `wrench`, `base`, `contact`, `imu`
    where the robot has them. `msg/State.msg` defines them all.

    An action is a setpoint of the robot's command kind, (n,), in wire order: positions [rad or m],
    accelerations [rad/s² or m/s²] or torques [N m or N]. It is held for the whole step. What
    exceeds the robot's limits is cut by its filter, and `info` says so.

    `info` has `tick`, `time_s`, `mode` of the robot; `late`, `lost`, `rejected` as State counts
    them; and of this step `interventions`, periods in which a joint was held back,
    `held_back`, the first such joint or None, and `torque_limited`, periods in which an effort did
    not suffice.

    Args:
        robot: name or file of an emulator config, a robot's path, settings, or a mapping.
        reward, terminated, truncated: of a `Transition`; by default 0 and False. An episode is
            truncated, too, when the robot has stopped following, as after misses.
        command: kind of the actions; by default what the config says, or the description's first.
        periods_per_step: control periods that an action is held for.

    Attributes:
        description: of the robot.
        step_s: duration of a step [s].
        state: the robot's newest State, to be read only; None before the first reset.
        observation_space, action_space: a dict of unbounded boxes, and a box of the usable ranges,
            of ± `brake_acceleration`, or of ± `effort`.

    Raises:
        UsageError: something in the settings is wrong.
    """

    observation_space: Dict
    action_space: Box[np.float64]

    def __init__(
        self,
        robot: str | Path | Mapping[str, Any] | EmulatorConfig = "hoap3",
        reward: Callable[[Transition], float] = lambda _: 0.0,
        terminated: Callable[[Transition], bool] = lambda _: False,
        truncated: Callable[[Transition], bool] = lambda _: False,
        *,
        command: CommandKind | None = None,
        periods_per_step: int = 1,
    ) -> None:
        if not (isinstance(periods_per_step, int) and periods_per_step >= 1):
            key, remedy = "periods_per_step", "Give a whole number from 1 on"
            raise ConfigError("Environment", key, periods_per_step, "is no such number", remedy)
        if isinstance(robot, Mapping):
            robot = parse(EmulatorConfig, dict(robot), "Environment(robot)")
        self._config = load_emulator_config(robot, seed=0)[0]
        if command is not None:
            self._config = self._config.model_copy(update={"command": command})
        tip, lock = self._config.tip, self._config.lock_joints
        self._loaded = load_configured(self._config.robot, "Environment(robot)", tip, lock)
        self.description: RobotDescription = describe(
            self._config, "Environment(robot)", self._loaded
        )
        self._reward, self._terminated, self._truncated = reward, terminated, truncated
        self._periods = periods_per_step
        self.step_s = periods_per_step * self.description.period_s
        self._stepwise: _Stepwise | None = None
        self._observation: Observation = {}
        self._over = True
        lengths = self.description.state_lengths
        self._names = (*PER_JOINT, *(name for name in SENSORS if lengths.get(name)))
        ends = {name: np.full(lengths[name], np.inf) for name in self._names}
        self.observation_space = Dict(
            {name: Box(-most, most, dtype=np.float64) for name, most in ends.items()}
        )
        self.action_space = Box(*self._action_range(), dtype=np.float64)

    def __repr__(self) -> str:
        kind = self.description.command_kinds[0]
        return f"Environment({self.description.name!r}, {kind}, {self.step_s:g} s a step)"

    @property
    def state(self) -> State | None:
        """See above."""
        return None if self._stepwise is None else self._stepwise.state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode: the robot at rest, in its first tick.

        Args:
            seed: of everything random in this episode and, drawn from it, in those after it.
                The same seed and actions give the same bytes of every State.
            options: `posture`, one of the description's, or `q`, (n,) [rad or m], to start from.

        Returns:
            The observation, and `info`.

        Raises:
            ConfigError: a wrong seed or option.
        """
        if seed is not None and not (isinstance(seed, int | np.integer) and 0 <= seed < MOST_SEEDS):
            remedy = "Give a whole number from 0 to 2⁶³ − 1"
            raise ConfigError("Environment.reset", "seed", seed, "is no such number", remedy)
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(MOST_SEEDS)) if seed is None else int(seed)
        config, robot = self._begun(options or {})
        config = config.model_copy(update={"seed": drawn})
        description = describe(config, "Environment.reset", robot)
        self._stepwise = _Stepwise(config, description)
        self._over = False
        self._observation = self._observed(self._stepwise.state)
        return dict(self._observation), self._info(self._stepwise, 0, 0, -1)

    def step(self, action: FloatArray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold an action for the periods of a step.

        Args:
            action: (n,), finite; see above.

        Returns:
            The observation, the reward, whether the episode has ended by itself, whether it was
            cut off, and `info`.

        Raises:
            ConfigError: the action has another shape, or is not finite; nothing has moved.
            UsageError: no episode is under way.
        """
        stepwise = self._stepwise
        if stepwise is None or self._over:
            why = "there is none" if stepwise is None else "the last one is over"
            raise UsageError(f"Environment.step needs an episode, and {why}. Call reset first")
        values, before = self._vector("Environment.step", "action", action), self._observation
        guard, held_back = stepwise.robot.setpoint_filter, -1
        interventions, limited = guard.interventions, self._torque_limited(stepwise)
        for _ in range(self._periods):
            stepwise.follow(values)
            if held_back < 0 and stepwise.active:
                held_back = guard.held_back
        info = self._info(
            stepwise,
            guard.interventions - interventions,
            self._torque_limited(stepwise) - limited,
            held_back,
        )
        self._observation = self._observed(stepwise.state)
        done = Transition(before, values, dict(self._observation), info)
        reward = float(self._reward(done))
        terminated = bool(self._terminated(done))
        truncated = bool(self._truncated(done)) or not stepwise.active
        self._over = terminated or truncated
        return done.after, reward, terminated, truncated, info

    def _begun(self, options: Mapping[str, Any]) -> tuple[EmulatorConfig, RobotDescription]:
        """The settings and the robot of an episode that starts as `options` say."""
        for name in options.keys() - set(OPTIONS):
            remedy = did_you_mean(str(name), OPTIONS, "Known: posture, q")
            raise ConfigError("Environment.reset", f"options.{name}", None, "is unknown", remedy)
        if "posture" in options and "q" in options:
            problem = "cannot stand beside options.posture"
            raise ConfigError("Environment.reset", "options.q", None, problem, "Give one of them")
        config, robot = self._config, self._loaded
        if "posture" in options:
            config = config.model_copy(update={"posture": str(options["posture"])})
        elif "q" in options:
            q = self._vector("Environment.reset", "options.q", options["q"])
            for joint in np.flatnonzero((q < robot.lower) | (q > robot.upper)):
                key, ends = f"options.q.{joint}", f"[{robot.lower[joint]}, {robot.upper[joint]}]"
                problem = f"{robot.joint_names[joint]} is outside its usable range"
                remedy = f"Stay within {ends}"
                raise ConfigError("Environment.reset", key, float(q[joint]), problem, remedy)
            config = config.model_copy(update={"posture": START})
            postures = {**robot.postures, START: tuple(q.tolist())}
            robot = robot.model_copy(update={"postures": postures})
        return config, robot

    def _vector(self, where: str, key: str, given: Any) -> FloatArray:
        """A finite number for each joint, as a new array.

        Raises:
            ConfigError: it is something else.
        """
        names = self.description.joint_names
        remedy = f"Give an array of {len(names)} numbers, in the order of description.joints"
        try:
            values = np.array(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ConfigError(where, key, given, "is no array of numbers", remedy) from error
        if values.shape != (len(names),):
            raise ConfigError(where, key, None, f"has the shape {values.shape}", remedy)
        for joint in np.flatnonzero(~np.isfinite(values)):
            problem = f"the number of {names[joint]} is not finite"
            raise ConfigError(where, f"{key}.{joint}", float(values[joint]), problem, remedy)
        return values

    def _action_range(self) -> tuple[FloatArray, FloatArray]:
        """Ends of the actions, (n,) each."""
        robot = self.description
        kind = robot.command_kinds[0]
        if kind == "position":
            return robot.lower, robot.upper
        most = robot.brake_acceleration if kind == "acceleration" else robot.effort
        return -most, most

    def _observed(self, state: State) -> Observation:
        return {name: getattr(state, name).copy() for name in self._names}

    def _info(
        self, stepwise: _Stepwise, interventions: int, limited: int, held_back: int
    ) -> dict[str, Any]:
        state, names = stepwise.state, self.description.joint_names
        return {
            "tick": state.tick,
            "time_s": state.stamp_intended * 1e-9,
            "mode": MODES[state.mode],
            "late": state.late,
            "lost": state.lost,
            "rejected": state.rejected,
            "interventions": interventions,
            "held_back": names[held_back] if held_back >= 0 else None,
            "torque_limited": limited,
        }

    @staticmethod
    def _torque_limited(stepwise: _Stepwise) -> int:
        robot = stepwise.robot
        return robot.setpoint_filter.torque_limited + robot.plant.saturated


class _Stepwise:
    """The loop, link and clock of `hoap3 run --lockstep`, with setpoints from outside.

    The robot follows from its first tick on, which has begun when this returns.

    Args:
        config, description: of the robot; the command kind is the description's first.

    Attributes:
        robot: its loop.
        state: its newest State.
    """

    def __init__(self, config: EmulatorConfig, description: RobotDescription) -> None:
        clock = VirtualClock()
        compute_time = round(config.lockstep.compute_time_us * 1e3)
        self._link = LockstepLink(self._receive, clock, compute_time)
        self.robot: RobotLoop = build_loop(
            config, description, clock, self._link, NoRecorder(), lockstep=True
        )
        self.state = State.allocate(**description.state_lengths)
        self._setpoint = Setpoint(description.n)
        self._setpoint.session_id = config.seed
        self._setpoint.command = COMMANDS[description.command_kinds[0]]
        self._ticker = Ticker(clock, self.robot.period, 0)
        self._link.ask("acquire", "environment")
        self._tick()

    @property
    def active(self) -> bool:
        """Whether the robot follows; not once misses have stopped it."""
        return self.state.mode == State.ACTIVE

    def follow(self, values: FloatArray) -> None:
        """Answer the newest State with a setpoint, (n,), and let the next tick come.

        A robot that does not follow is not answered.
        """
        state, setpoint = self.state, self._setpoint
        if self.active:
            setpoint.tick, setpoint.epoch = state.tick, state.epoch
            setpoint.stamp_state = state.stamp_published
            setpoint.values[:] = values
            self._link.send(setpoint.dump())
        self._tick()

    def _tick(self) -> None:
        self._ticker.wait()
        self.robot.step(self._ticker)

    def _receive(self, state: bytes) -> None:
        """Take a State; the answer comes later, at the same virtual time."""
        self.state.load(state)
