"""A body in MuJoCo by itself: at rest, driven, touching, and measured."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hoap3.protocol.errors import DescriptionError, SolverError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import EmulatorConfig, PlantSettings
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe

T = 0.001
STIFF = {"kp": 600.0, "kv": 12.0, "armature": 0.01}
POINT = 1e-6  # rad: a servo at rest moves no more


def body(robot: str, command: str, encoder: str = "ideal", seed: int = 0, **parameters: Any):
    """A plant at rest in its start posture, and its description."""
    settings = PlantSettings(kind="mujoco", parameters=parameters, encoder=encoder)
    description = describe(EmulatorConfig(robot=robot, command=command, plant=settings))
    given = MujocoPlant.Parameters(**parameters)
    made = MujocoPlant.configured(description, settings, given, seed)
    made.reset(description.initial_position)
    return made, description


def standing(**parameters: Any) -> tuple[MujocoPlant, RobotDescription]:
    return body("hoap3", "position", base="free", **{**STIFF, **parameters})


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_servos_start_in_static_equilibrium(base: str):
    made, description = body("hoap3", "position", base=base, **STIFF)
    before = made.data.qpos.copy()
    for _ in range(500):
        made.step(made.start, T)
    np.testing.assert_allclose(made.data.qpos, before, atol=POINT)
    np.testing.assert_allclose(made.q, description.initial_position, atol=POINT)
    assert np.abs(made.tau).max() > 1.0  # it does carry itself
    np.testing.assert_allclose(made.tau, 600.0 * (made.start - made.q), atol=1e-3)


def test_what_stands_presses_with_its_weight_and_feels_gravity():
    made, _ = standing()
    for _ in range(100):
        made.step(made.start, T)
    right, left = made.contact.reshape(2, 6)
    weight = 9.81 * float(made.model.body_subtreemass[1])
    lean = 1.0 - np.cos(2e-3)  # of the soles, which give way by less than 2 mrad
    assert right[2] + left[2] == pytest.approx(weight, rel=lean)
    assert made.imu[7:] == pytest.approx([0.0, 0.0, 9.81], abs=0.05)  # its axes lean a little
    np.testing.assert_allclose(made.imu[:4], made.base[3:7], atol=1e-6)
    np.testing.assert_allclose(made.base[7:], 0.0, atol=1e-5)
    told = made.summary()
    com, up = np.array(told["com_m"]), made.data.site("frame r_sole").xmat.reshape(3, 3)[2]
    below = com - up * com[2] / up[2]  # along the vertical, on the sole, which leans
    assert told["zmp_m"] == pytest.approx(below[:2], abs=1e-6)
    assert told["com_by_model_m"] == pytest.approx(told["com_m"], abs=1e-9)
    assert told["periods_off_the_ground"] == {"r_sole": 0, "l_sole": 0}


def test_a_held_foot_has_the_zero_moment_point_of_a_robot_at_rest():
    made, _ = body("hoap3", "position", **STIFF)
    made.step(made.start, T)
    told = made.summary()
    assert told["zmp_m"] == pytest.approx(told["com_m"][:2], abs=1e-6)
    assert told["com_m"] == pytest.approx([-0.0085, 0.0279, 0.2869], abs=1e-6)  # of the paper
    assert made.contact.size == made.base.size == made.imu.size == 0


def test_a_wrench_sensor_and_a_contact_frame_of_one_foot_agree():
    plain, description = standing()
    robot = description.model_copy(update={"wrench_sensors": ("l_shank",)})
    made = MujocoPlant(robot, MujocoPlant.Parameters(base="free", **STIFF))
    made.reset(robot.initial_position)
    for _ in range(50):
        made.step(made.start, T)
        plain.step(plain.start, T)
    assert np.linalg.norm(made.wrench[:3]) == pytest.approx(np.linalg.norm(plain.contact[6:9]))
    assert np.linalg.norm(made.wrench[:3]) > 10.0


def test_a_servo_cannot_give_more_than_the_efforts():
    made, description = body("ur5", "position", kp=1e5, kv=10.0)
    far = description.initial_position + 0.5
    for _ in range(20):
        made.step(far, T)
        assert (np.abs(made.tau) <= description.effort * (1.0 + 1e-12)).all()
    assert np.abs(made.tau / description.effort).max() == pytest.approx(1.0)


def test_accelerations_are_what_was_commanded():
    made, description = body("lwr", "acceleration", joint_friction=True)
    ddq = np.linspace(-0.8, 1.0, description.n)
    for _ in range(50):
        made.step(ddq, T)
    np.testing.assert_allclose(made.dq, 0.05 * ddq, atol=1e-12)


def test_torques_that_hold_it_hold_it_and_gravity_compensation_needs_none():
    made, description = body("lwr", "torque")
    weight = np.zeros(description.n)
    Dynamics(description).gravity(description.initial_position, weight)
    for _ in range(10):
        made.step(weight, T)
    np.testing.assert_allclose(made.q, description.initial_position, atol=1e-9)
    free = MujocoPlant(
        description.model_copy(update={"gravity": "compensated"}), MujocoPlant.Parameters()
    )
    free.reset(description.initial_position)
    for _ in range(10):
        free.step(0.0 * weight, T)
    np.testing.assert_allclose(free.q, description.initial_position, atol=1e-9)
    np.testing.assert_allclose(free.tau, weight, atol=1e-6)


def test_nobody_commands_and_the_servos_hold_it_as_brakes():
    made, description = body("lwr", "torque")
    push = np.zeros(description.n)
    Dynamics(description).gravity(description.initial_position, push)
    push[0] += 5.0
    for _ in range(50):
        made.step(push, T)
    moving, place = abs(made.dq[0]), made.q.copy()
    assert moving > 0.05
    for _ in range(1000):
        made.hold(T)
    assert np.abs(made.dq).max() < 1e-6
    assert np.abs(made.q - place).max() < 0.02


def test_the_model_of_torques_is_the_plant_itself_contacts_included():
    made, description = body("humanoid32", "torque", base="free")
    model, found = made.torque_model, np.zeros(description.n)
    needed, wanted = np.zeros(description.n), np.zeros(description.n)
    wanted[description.joint_names.index("waist_yaw")] = 1.0
    assert model is not None
    model.accelerations(made.tau, T, found)
    at_rest = np.linalg.norm(found - wanted)
    assert model.torques(wanted, T, needed) == -1
    model.accelerations(needed, T, found)
    assert np.linalg.norm(found - wanted) < 0.25 * at_rest
    before = made.dq.copy()
    made.step(needed, T)
    np.testing.assert_allclose((made.dq - before) / T, found, atol=0.05)
    assert model.torques(1e6 * wanted, T, needed) >= 0
    assert 0.0 < model.share(1e4 * wanted, T) < 1.0


def test_an_arm_stops_at_a_box_and_presses_on_it():
    start = load("lwr").model_copy(update={"initial_posture": "bent"})
    box = {"position_m": [-0.7, -0.4, 0.2], "size_m": [0.6, 0.6, 0.4]}
    links = ["link_4", "link_5", "link_6", "ee"]
    reached = []
    for parameters in ({"boxes": [box]}, {}):
        made = MujocoPlant(
            start.model_copy(
                update={"command_kinds": ("position",), "state_arrays": {"contact": 24}}
            ),
            MujocoPlant.Parameters(contact_frames=links, **parameters),
        )
        made.reset(start.initial_position)
        target = start.initial_position.copy()
        target[1] += 0.8  # down and forwards
        for k in range(1500):
            share = min(1.0, k / 1000.0)
            made.step(made.start + share * (target - start.initial_position), T)
        reached.append((made.q[1], np.abs(made.contact).max()))
    assert reached[0][0] < reached[1][0] - 0.05
    assert reached[0][1] > 10.0
    assert reached[1][1] == 0.0


def test_noise_is_that_of_the_encoders_and_of_the_seed():
    shown = []
    for seed in (1, 1, 2):
        made, description = body("hoap3", "position", seed=seed, noise_rad=1e-4, **STIFF)
        readings = []
        for _ in range(200):
            made.step(made.start, T)
            readings.append(made.q.copy())
        shown.append(np.array(readings))
    np.testing.assert_array_equal(shown[0], shown[1])
    assert (shown[0] != shown[2]).all()
    off = shown[0] - description.initial_position
    assert np.std(off) == pytest.approx(1e-4, rel=0.05)


def test_a_robot_that_cannot_stand_says_so_and_may_fall():
    with pytest.raises(DescriptionError, match="lwr"):
        body("lwr", "position", base="free")
    made, _ = body("lwr", "position", base="free", position_m=[0.0, 0.0, 1.0])
    for _ in range(100):
        made.step(made.start, T)
    assert made.base[9] < -0.9  # 0.1 s of free fall


def test_a_state_that_is_not_finite_ends_it():
    made, description = body("lwr", "torque")
    made.data.qvel[0] = np.nan
    with pytest.raises(SolverError, match="substeps"):
        made.step(np.zeros(description.n), T)


@pytest.mark.parametrize("command", ["position", "acceleration", "torque"])
def test_what_is_compensated_already_is_not_held_a_second_time(command: str):
    settings = PlantSettings(kind="mujoco", gravity="compensated")
    config = EmulatorConfig(robot="lwr", command=command, posture="bent", plant=settings)
    description = describe(config)
    made = MujocoPlant(description, MujocoPlant.Parameters(servo_rad_s=20.0))
    made.reset(description.initial_position)
    np.testing.assert_allclose(made.start, description.initial_position, atol=POINT)
    if command != "position":
        made.step(np.zeros(description.n), T)  # so that brakes are let go, and close anew
    for _ in range(300):
        made.step(made.start, T) if command == "position" else made.hold(T)
    np.testing.assert_allclose(made.q, description.initial_position, atol=POINT)
    assert np.abs(made.tau).max() > 1.0  # what compensates it
