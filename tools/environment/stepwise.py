"""The robot of a lockstep run, whose setpoints are handed in from outside, period by period."""

from __future__ import annotations

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.messages import COMMANDS, FloatArray, Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import NoRecorder, Recorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from hoap3.robot_emulator.service import build_loop

WHO = "environment"


class StepwiseRobot:
    """The same loop, link and clock as of `hoap3 run --lockstep`, without a controller.

    The robot follows from its first tick on, which has begun when this returns.

    Args:
        config, description: of the robot; the command kind is the description's first.
        recorder: where its log goes; nowhere by default.

    Attributes:
        robot: its loop.
        state: its newest State.
    """

    def __init__(
        self,
        config: EmulatorConfig,
        description: RobotDescription,
        recorder: Recorder | None = None,
    ) -> None:
        clock = VirtualClock()
        compute_time = round(config.lockstep.compute_time_us * 1e3)
        self._link = LockstepLink(self._hear, clock, compute_time)
        self.robot: RobotLoop = build_loop(
            config, description, clock, self._link, recorder or NoRecorder(), lockstep=True
        )
        self.state = State.allocate(**description.state_lengths)
        self._setpoint = Setpoint(description.n)
        self._setpoint.session_id = config.seed
        self._setpoint.command = COMMANDS[description.command_kinds[0]]
        self._ticker = Ticker(clock, self.robot.period, 0)
        self._link.ask("acquire", WHO)
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

    def _hear(self, state: bytes) -> None:
        """Take a State; the answer comes later, at the same virtual time."""
        self.state.load(state)
