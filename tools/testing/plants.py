"""What every plant must do, whoever wrote it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.base import TOLD, Plant
from hoap3.robot_emulator.service import describe
from hoap3.tools.environment.environment import Environment
from hoap3.tools.services.configs import load_emulator_config
from hoap3.tools.testing.suite import Suite, Value, over

PERIODS = 400  # of a motion that is looked at
ARRAYS = ("q", "dq", "tau", "wrench", "start", *TOLD)


class PlantCase:
    """A plant as an emulator config has it.

    Args:
        given: name or file of the config, or a mapping with its content.
    """

    def __init__(self, given: object) -> None:
        self._given = given
        if isinstance(given, Mapping):
            self.label = " ".join(f"{key}={value}" for key, value in given.items())
        else:
            self.label = Path(str(given)).name

    @cached_property
    def config(self) -> EmulatorConfig:
        """Its settings."""
        if isinstance(self._given, Mapping):
            return parse(EmulatorConfig, dict(self._given), self.label)
        return load_emulator_config(str(self._given))[0]

    @cached_property
    def robot(self) -> RobotDescription:
        """Description of its robot."""
        return describe(self.config, self.label)


class Moved:
    """A plant behind its robot's filter, which swings about where it starts.

    Attributes:
        plant: the body.
    """

    def __init__(self, case: PlantCase) -> None:
        self._robot = case.robot
        self.plant: Plant
        self.plant, self._filter = build_body(case.robot, case.config)
        self.restart(np.array(case.robot.initial_position))

    def restart(self, q: FloatArray) -> None:
        """Be at rest at a posture."""
        self.plant.reset(q)
        self._filter.reset(self.plant.start)
        self._filter.forget()
        self._tick = 0

    def command(self) -> FloatArray:
        """What the filter lets through of a swing: of 0.05 rad or m, or of a tenth of the most."""
        robot, tick = self._robot, self._tick
        wave = np.sin(2.0 * np.pi * tick * robot.period_s + np.arange(robot.n))
        match robot.command_kinds[0]:
            case "position":
                setpoint = self.plant.start + 0.05 * (wave - np.sin(np.arange(robot.n)))
            case "acceleration":
                setpoint = 0.1 * robot.brake_acceleration * wave
            case _:
                setpoint = 0.1 * robot.effort * wave
        self._filter.follow(setpoint, tick)
        self._tick += 1
        return self._filter.value

    def step(self) -> bytes:
        """One period of the swing; what it measures then."""
        self.plant.step(self.command(), self._robot.period_s)
        return self.said()

    def hold(self) -> bytes:
        """One period in which nobody commands; what it measures then."""
        self.plant.hold(self._robot.period_s)
        return self.said()

    def said(self) -> bytes:
        """What it measures, as bytes; −0 is 0."""
        return b"".join((array + 0.0).tobytes() for array in self.arrays())

    def arrays(self) -> list[FloatArray]:
        """Those that it fills."""
        return [getattr(self.plant, name) for name in ARRAYS]

    def story(self) -> list[bytes]:
        """A swing, a while at rest, and a swing again."""
        swing = [self.step() for _ in range(PERIODS // 2)]
        rest = [self.hold() for _ in range(PERIODS // 10)]
        return swing + rest + [self.step() for _ in range(PERIODS // 2)]


def every(suite: PlantProperties) -> list[Value]:
    """All cases."""
    return [Value((case,), case.label) for case in map(PlantCase, suite.cases)]


def differs_at(told: Sequence[bytes], again: Sequence[bytes]) -> int | None:
    """Where two stories first differ; None where they do not. A diff of them would take minutes."""
    pairs = enumerate(zip(told, again, strict=True))
    return next((place for place, (one, other) in pairs if one != other), None)


class PlantProperties(Suite):
    """What every plant must do.

    Attributes:
        cases: emulator configs, by name or file, or mappings with their content.
    """

    cases: ClassVar[Sequence[Any]] = ()

    @over("case", every)
    def test_its_arrays_are_as_declared_and_laid_out_once(self, case: PlantCase) -> None:
        robot, body, other = case.robot, Moved(case), Moved(case)
        arrays = body.arrays()
        lengths = {
            **dict.fromkeys(("q", "dq", "tau", "start"), robot.n),
            "wrench": 6 * len(robot.wrench_sensors),
            **{name: robot.state_arrays.get(name, 0) for name in TOLD},
        }
        for name, array in zip(ARRAYS, arrays, strict=True):
            assert array.shape == (lengths[name],), name
            assert array.dtype == np.float64, name
        body.story()
        body.restart(robot.initial_position)
        assert all(now is before for now, before in zip(body.arrays(), arrays, strict=True))
        for place, array in enumerate(arrays):
            theirs = [*arrays[:place], *arrays[place + 1 :], *other.arrays()]
            assert not any(np.shares_memory(array, each) for each in theirs)

    @over("case", every)
    def test_it_starts_at_rest_where_it_is_put(self, case: PlantCase) -> None:
        body = Moved(case)
        body.story()
        body.restart(case.robot.initial_position)
        assert not body.plant.dq.any()
        assert all(np.isfinite(array).all() for array in body.arrays())
        away = np.abs(body.plant.q - case.robot.initial_position)
        counts = case.robot.counts_per_rad
        if case.config.plant.encoder == "ideal" or counts is None:
            assert not away.any()
        else:
            assert (away <= 0.5 / np.abs(counts) + np.finfo(float).eps).all()

    @over("case", every)
    def test_it_keeps_no_hold_of_what_it_is_given(self, case: PlantCase) -> None:
        body, twin = Moved(case), Moved(case)
        start = np.array(case.robot.initial_position)
        body.restart(start)
        start += 1.0
        for _ in range(20):
            command = body.command().copy()
            given = command.copy()
            body.plant.step(given, case.robot.period_s)
            np.testing.assert_array_equal(given, command)
            given += 1.0
            assert body.said() == twin.step()
        assert body.hold() == twin.hold()

    @over("case", every)
    def test_everything_is_finite(self, case: PlantCase) -> None:
        body = Moved(case)
        started = body.plant.q.copy()
        for told in body.story():
            assert np.isfinite(np.frombuffer(told)).all()
        assert (body.plant.q != started).any()  # it moved at all

    @over("case", every)
    def test_the_same_commands_give_the_same_bytes(self, case: PlantCase) -> None:
        first, second = Moved(case), Moved(case)
        assert differs_at(first.story(), second.story()) is None
        summary = json.dumps(first.plant.summary())
        assert summary == json.dumps(second.plant.summary())
        assert all(isinstance(line, str) for line in first.plant.notes())

    @over("case", every)
    def test_a_reset_forgets_everything(self, case: PlantCase) -> None:
        fresh, used = Moved(case), Moved(case)
        for _ in range(30):
            used.step()
        used.hold()
        used.restart(case.robot.initial_position)
        assert used.said() == fresh.said()
        assert differs_at(used.story(), fresh.story()) is None

    @over("case", every)
    def test_a_run_in_lockstep_repeats_bit_by_bit(self, case: PlantCase) -> None:
        told = []
        for _ in range(2):
            env = Environment(case.config)
            before, _ = env.reset(seed=3)
            middle = (env.action_space.low + env.action_space.high) / 2
            middle[~np.isfinite(middle)] = 0.0
            position = case.robot.command_kinds[0] == "position"
            for _ in range(50):
                action = before["reference"] + 1e-4 if position else middle
                before, *_ = env.step(action)
            assert env.state is not None
            told.append(env.state.dump())
        assert told[0] == told[1]
