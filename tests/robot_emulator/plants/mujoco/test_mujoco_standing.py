"""Robots in MuJoCo that are commanded torques and may fall: pushes, rotors, and their filter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import EmulatorConfig, PlantSettings
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.service import describe

T = 0.001
PUSH = {"frame": "pelvis", "at_s": 0.01, "for_s": 0.02, "force_n": [100.0, 0.0, 50.0]}


def config(**parameters: Any) -> EmulatorConfig:
    plant = PlantSettings(kind="mujoco", parameters={"base": "free", **parameters})
    return EmulatorConfig(robot="hoap3", command="torque", plant=plant)


def built(**parameters: Any) -> tuple[Any, Any, RobotDescription]:
    """Plant and filter at rest, and the description."""
    settings = config(**parameters)
    description = describe(settings)
    plant, before = build_body(description, settings)
    plant.reset(description.initial_position)
    before.reset(plant.start)
    return plant, before, description


def momentum(plant: Any) -> np.ndarray:
    import mujoco

    mujoco.mj_forward(plant.model, plant.data)
    mujoco.mj_subtreeVel(plant.model, plant.data)
    mass = plant.model.body_subtreemass[plant.built.root]
    return np.asarray(mass * plant.data.subtree_linvel[plant.built.root])


def error_of_gain(substeps: int) -> float:
    """Greatest difference of what a push adds from its impulse, at any time [N s]."""
    falling = {"position_m": [0.0, 0.0, 50.0], "collide": "none", "substeps": substeps}
    pushed, _, description = built(pushes=[PUSH], **falling)
    free, _, _ = built(**falling)
    nothing, worst = np.zeros(description.n), 0.0
    for tick in range(40):
        pushed.step(nothing, T)
        free.step(nothing, T)
        share = min(max((tick + 1) * T - 0.01, 0.0), 0.02)
        gained = momentum(pushed) - momentum(free)
        worst = max(worst, np.abs(gained - np.array([100.0, 0.0, 50.0]) * share).max())
    return worst


def test_a_push_adds_its_impulse_while_it_lasts():
    """To first order in the step: of one period, and of a quarter of one."""
    coarse, fine = error_of_gain(1), error_of_gain(4)
    assert coarse < T * 100.0 * 0.1  # less than a tenth of what a single step too many would add
    assert fine < 0.3 * coarse


def test_a_push_at_a_link_that_is_not_there_is_refused():
    with pytest.raises(ConfigError) as caught:
        describe(config(pushes=[{**PUSH, "frame": "tail"}]))
    assert caught.value.key == "plant.parameters.pushes.0.frame"


def test_controllers_are_told_of_the_rotors_of_the_simulation():
    assert np.array_equal(describe(config(armature=0.02)).armature, np.full(21, 0.02))
    some = describe(config(armature={"r_knee": 0.03})).armature
    assert some.sum() == some.max() == 0.03
    assert np.array_equal(describe(config()).armature, np.zeros(21))


def test_a_named_plant_takes_what_it_can_and_without_one_the_robot_decides():
    assert describe(config()).command_kinds == ("torque",)
    with pytest.raises(ConfigError) as caught:
        describe(EmulatorConfig(robot="hoap3", command="torque"))
    assert caught.value.key == "command"


def test_torques_of_what_may_fall_are_cut_to_the_efforts_alone():
    plant, before, description = built(armature=0.01)
    plant.step(np.zeros(description.n), T)
    given = np.linspace(-0.99, 0.99, description.n) * description.effort
    assert before.follow(given, 0) == -1
    assert np.array_equal(before.value, given)
    given[[3, 5]] = 10.0, -10.0
    assert before.follow(given, 1) == 3
    assert before.value[3] == description.effort[3]
    assert before.value[5] == -description.effort[5]
    others = np.delete(np.arange(description.n), [3, 5])
    assert np.array_equal(before.value[others], given[others])
    assert before.interventions == 1
