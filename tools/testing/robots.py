"""What every robot must be, whoever described it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.links import INERTIA_KEYS, is_possible_inertia
from hoap3.tools.environment.environment import Environment
from hoap3.tools.testing.numerics import posture
from hoap3.tools.testing.suite import Suite, Value, over

POSTURES = 50
STEPS = 300


class RobotCase:
    """A robot.

    Args:
        name: registered, or a path, as `hoap3.load_robot` takes it.
    """

    def __init__(self, name: str) -> None:
        self.name, self.label = name, Path(name).name

    @cached_property
    def robot(self) -> RobotDescription:
        """Its description."""
        return load(self.name)

    @property
    def urdf(self) -> ET.Element:
        """Its URDF, which was checked when it was read."""
        return ET.fromstring(self.robot.urdf)  # noqa: S314

    @property
    def has_dynamics(self) -> bool:
        """Whether it takes more than positions, so that its masses count."""
        return self.robot.command_kinds != ("position",)


@cache
def robot_case(name: str) -> RobotCase:
    """The one case of that name."""
    return RobotCase(name)


def every(suite: RobotProperties) -> list[Value]:
    """All cases."""
    return [Value((case,), case.label) for case in suite.known()]


def with_dynamics(suite: RobotProperties) -> list[Value]:
    """Those that take accelerations or torques."""
    return [Value((case,), case.label) for case in suite.known() if case.has_dynamics]


def commands(suite: RobotProperties) -> list[Value]:
    """Every case with each kind of setpoints that it takes."""
    return [
        Value((case, kind), f"{case.label}-{kind}")
        for case in suite.known()
        for kind in case.robot.command_kinds
    ]


class RobotProperties(Suite):
    """What every robot must be.

    Attributes:
        cases: names or paths, as `hoap3.load_robot` takes them.
    """

    cases: ClassVar[Sequence[Any]] = ()

    def known(self) -> list[RobotCase]:
        """The cases, each with its description."""
        return [robot_case(str(case)) for case in self.cases]

    @over("case", every)
    def test_its_description_travels(self, case: RobotCase) -> None:
        robot = case.robot
        there = RobotDescription.from_json(robot.to_json())
        assert there == robot
        assert there.digest == robot.digest

    @over("case", every)
    def test_its_mass_is_the_sum_of_the_urdf(self, case: RobotCase) -> None:
        masses = [float(mass.get("value", 0)) for mass in case.urdf.iter("mass")]
        assert build_model(case.robot).total_mass == pytest.approx(sum(masses), rel=1e-12)

    @over("case", every)
    def test_every_inertia_is_that_of_a_body(self, case: RobotCase) -> None:
        """No principal moment negative, or larger than the sum of the other two."""
        for inertial in case.urdf.iter("inertial"):
            mass, inertia = inertial.find("mass"), inertial.find("inertia")
            if mass is not None and inertia is not None:
                moments = np.array([float(inertia.get(key, 0)) for key in INERTIA_KEYS])
                assert is_possible_inertia(float(mass.get("value", 0)), moments), inertia.attrib

    @over("case", every)
    def test_wire_order_is_that_of_the_model_by_name(self, case: RobotCase) -> None:
        built = build_model(case.robot)
        names = [built.model.names[1 + int(index)] for index in built.order]
        assert tuple(names) == case.robot.joint_names

    @over("case", every)
    def test_its_postures_are_usable(self, case: RobotCase) -> None:
        robot = case.robot
        assert robot.initial_posture in robot.postures
        for values in robot.postures.values():
            assert np.all(robot.lower <= values)
            assert np.all(values <= robot.upper)

    @over("case", with_dynamics)
    def test_its_mass_matrix_is_positive_definite(self, case: RobotCase) -> None:
        dynamics = Dynamics(case.robot)
        for seed in range(POSTURES):
            M = dynamics.mass(posture(case.robot, seed))
            np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-12 * np.abs(M).max())
            scale = 1.0 / np.sqrt(np.diag(M))
            assert np.linalg.eigvalsh(scale[:, None] * M * scale)[0] > 1e-12

    @over("case", with_dynamics)
    def test_it_can_hold_itself_where_it_starts(self, case: RobotCase) -> None:
        robot = case.robot
        if "torque" not in robot.command_kinds:
            return
        weight = np.zeros(robot.n)
        Dynamics(robot).gravity(np.array(robot.initial_position), weight)
        assert np.all(np.abs(weight) < robot.effort)

    @over("case,kind", commands)
    def test_its_limits_hold_whatever_is_asked_of_it(self, case: RobotCase, kind: Any) -> None:
        env, robot = Environment({"robot": case.name}, command=kind), case.robot
        low, high = env.action_space.low, env.action_space.high
        middle = np.where(np.isfinite(low + high), (low + high) / 2, robot.initial_position)
        most = np.where(np.isfinite(high - low), high - low, 10.0)
        before, _ = env.reset(seed=0)
        rng, fastest, T = np.random.default_rng(0), np.zeros(robot.n), robot.period_s
        for _ in range(STEPS):
            after, *_ = env.step(middle + 3.0 * most * rng.normal(size=robot.n))
            place, rate = after["reference"], after["reference_rate"]
            ulps = 8.0 * np.spacing(np.abs(place))  # of a position, as docs/guides/logs.md has it
            away = ulps if kind == "position" else 1e-9
            assert (place >= robot.lower - away).all()
            assert (place <= robot.upper + away).all()
            assert (np.abs(rate) <= robot.velocity * (1.0 + 1e-9) + ulps / T).all()
            if kind == "position":
                gained = np.abs(rate - before["reference_rate"])
                assert (gained <= robot.setpoint_acceleration_max * T + ulps / T).all()
            fastest, before = np.maximum(fastest, np.abs(rate)), after
        assert (fastest > 0.0).any()  # it moved at all
