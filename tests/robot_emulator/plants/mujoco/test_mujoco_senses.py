"""What the plant in MuJoCo tells of contacts, of its base and of a fall, beside MuJoCo itself."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hoap3.protocol.errors import SolverError
from hoap3.robot_emulator.config import EmulatorConfig, PlantSettings
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.service import describe

T = 0.001
ANKLES = [4, 14]  # r_ankle_pitch and l_ankle_pitch
STIFF = {"kp": 600.0, "kv": 12.0, "armature": 0.01}


def standing(**parameters: object) -> MujocoPlant:
    """HOAP-3 at rest on its own feet."""
    given = {"base": "free", **STIFF, **parameters}
    settings = PlantSettings(kind="mujoco", parameters=given)
    description = describe(EmulatorConfig(robot="hoap3", command="position", plant=settings))
    made = MujocoPlant(description, MujocoPlant.Parameters.model_validate(given))
    made.reset(description.initial_position)
    return made


def lean(made: MujocoPlant, by: float, periods: int) -> None:
    """Have both ankles turn the robot forwards or backwards."""
    target = made.start.copy()
    target[ANKLES] += by
    for _ in range(periods):
        made.step(target, T)


def pressed(made: MujocoPlant, frame: str) -> NDArray[np.float64]:
    """Force and torque on a link about a frame of it, in its axes, of all contacts, (6,)."""
    model, data = made.model, made.data
    site = made.built.site(frame)
    place, axes = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    body, found = int(model.site_bodyid[site]), np.zeros(6)
    for number in range(data.ncon):
        contact, local = data.contact[number], np.zeros(6)
        mujoco.mj_contactForce(model, data, number, local)
        first, second = model.geom_bodyid[contact.geom]
        sign = float(second == body) - float(first == body)
        turned = contact.frame.reshape(3, 3).T
        force, torque = sign * turned @ local[:3], sign * turned @ local[3:]
        found[:3] += axes.T @ force
        found[3:] += axes.T @ (torque + np.cross(contact.pos - place, force))
    return found


def test_contact_torques_are_those_of_pressures_at_their_arms():
    made = standing()
    lean(made, 0.02, 40)
    found = made.contact.reshape(2, 6)
    for wrench, frame in zip(found, ("r_sole", "l_sole"), strict=True):
        np.testing.assert_allclose(wrench, pressed(made, frame), atol=1e-9)
        assert np.abs(wrench[3:]).max() > 0.1


def test_contact_forces_are_means_over_the_substeps():
    made = standing(substeps=4)
    lean(made, 0.0, 50)
    weight = 9.81 * float(made.model.body_subtreemass[made.built.root])
    assert made.contact[[2, 8]].sum() == pytest.approx(weight, rel=1e-4)


def test_one_that_tips_over_is_seen_to():
    made = standing()
    lean(made, 0.3, 1500)
    told = made.summary()
    assert all(tilt > 10.0 for tilt in told["largest_tilt_deg"].values())
    assert all(count > 10 for count in told["periods_off_the_ground"].values())
    assert told["warnings"] == {}


def test_the_base_tells_how_it_turns_in_the_world():
    """In free fall, spinning about an axis that lies slanted in the root link."""
    made = standing(position_m=[0.0, 0.0, 50.0], rotation_rad=[0.4, -0.3, 0.8])
    made.data.qvel[3:6] = 1.0, -2.0, 3.0
    made.step(made.start, T)
    before, rate = made.base.copy(), made.base[10:13].copy()
    made.step(made.start, T)
    turned, back, change = np.zeros(4), np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(back, before[[6, 3, 4, 5]])
    mujoco.mju_mulQuat(turned, made.base[[6, 3, 4, 5]], back)  # seen in the world
    mujoco.mju_quat2Vel(change, turned, T)
    np.testing.assert_allclose(0.5 * (rate + made.base[10:13]), change, atol=0.01)
    assert np.linalg.norm(rate) > 3.0
    np.testing.assert_allclose((made.base[:3] - before[:3]) / T, made.base[7:10], atol=1e-9)


def test_what_mujoco_warns_of_is_counted():
    made = standing()
    made.data.qvel[0] = np.nan
    with pytest.raises(SolverError):
        made.step(made.start, T)
    assert made.summary()["warnings"]["mjWARN_BADQVEL"] == 1
