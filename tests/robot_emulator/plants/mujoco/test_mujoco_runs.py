"""A robot in MuJoCo with its filter and its loop: stops, brakes, the same bytes twice."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import Bench

from hoap3.protocol.messages import State
from hoap3.robot_emulator.config import EmulatorConfig, PlantSettings, read_config
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.simulate import simulate


def bench(robot: str, command: str, **parameters: object) -> Bench:
    plant = PlantSettings(kind="mujoco", parameters=parameters)
    description = describe(EmulatorConfig(robot=robot, command=command, plant=plant))
    made = Bench(description=description, plant=plant)
    made.link.ask("acquire", "me")
    return made


def test_two_runs_of_one_seed_have_the_same_bytes():
    content, _ = read_config("hoap3_standing")
    content["plant"]["parameters"]["noise_rad"] = 1e-4
    runs = [simulate(content, "stable_qp_standing", 0.05, seed=seed).states for seed in (3, 3, 4)]
    assert runs[0].tobytes() == runs[1].tobytes()
    assert (runs[0]["q"][1:] != runs[2]["q"][1:]).all()
    assert runs[0]["base"].shape[1] == 13
    assert runs[0]["contact"].shape[1] == 12
    assert runs[0]["imu"].shape[1] == 10


def test_the_reference_begins_where_servos_hold_the_robot():
    made = bench("hoap3", "position", kp=600.0, kv=12.0, armature=0.01)
    first = made.run(1)
    sag = first.reference - first.q
    assert 1e-3 < np.abs(sag).max() < 0.01
    last = made.run(200)
    np.testing.assert_allclose(last.reference, first.reference, atol=1e-12)
    np.testing.assert_allclose(last.q, first.q, atol=1e-6)


@pytest.mark.parametrize("command", ["acceleration", "torque"])
def test_silence_ends_in_a_stop_that_the_servos_hold(command: str):
    made = bench("lwr", command)
    push = np.zeros(made.n)
    made.values[:] = made.run(1).tau if command == "torque" else push
    made.values[0] += 3.0 if command == "torque" else 2.0
    moving = made.run(150)
    assert moving.mode == State.ACTIVE
    assert moving.dq[0] > 0.1
    made.fate = lambda tick, answer: []
    stopped = made.run(600)
    assert stopped.mode == State.STOPPED
    later = made.run(500)
    assert np.abs(later.dq).max() < 1e-4
    np.testing.assert_allclose(later.q, stopped.q, atol=0.01)


def test_a_humanoid_stands_on_its_feet_while_nobody_commands_its_torques():
    plant = PlantSettings(kind="mujoco", parameters={"base": "free"})
    config = EmulatorConfig(robot="humanoid32", command="torque", plant=plant)
    made = Bench(description=describe(config), plant=plant)
    first, last = made.run(1), made.run(300)
    np.testing.assert_allclose(last.base[:3], first.base[:3], atol=1e-6)
    assert (last.contact.reshape(2, 6)[:, 2] > 100.0).all()
