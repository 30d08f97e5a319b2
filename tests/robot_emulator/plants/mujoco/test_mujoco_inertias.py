"""Inertias that MuJoCo would refuse."""

from __future__ import annotations

import numpy as np
import pytest
from support.small_arm import URDF, arm

from hoap3.robot_emulator.plants.mujoco.model import build_model
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters

USUAL = 'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"'
HAND = URDF.index('<link name="hand">')


def with_hand(mass: str, inertia: str) -> str:
    hand = URDF[HAND:].replace('<mass value="1"/>', f'<mass value="{mass}"/>', 1)
    return URDF[:HAND] + hand.replace(USUAL, inertia, 1)


@pytest.mark.parametrize(
    ("mass", "inertia", "expected"),
    [
        ("1", USUAL, None),
        ("1", 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"', (1e-9, 1e-9, 1e-9)),
        ("1", 'ixx="1e-4" iyy="1e-4" izz="0" ixy="0" ixz="0" iyz="0"', (1e-10, 1e-4, 1e-4)),
        ("1", 'ixx="1e-4" iyy="1e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"', (7e-4 / 3,) * 3),
        ("0", 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"', (2e-15,) * 3),
    ],
)
def test_what_is_altered_is_named_and_nothing_else(mass, inertia, expected):
    robot = arm(urdf=with_hand(mass, inertia))
    built = build_model(robot, MujocoParameters())
    found = np.sort(built.model.body("hand").inertia)
    assert set(built.altered) == ({"hand"} if expected else set())
    np.testing.assert_allclose(found, expected or (0.01, 0.01, 0.01), rtol=1e-6)
    np.testing.assert_allclose(built.model.body("fore").inertia, 0.01, rtol=1e-12)
    notes = " ".join(MujocoPlant(robot, MujocoPlant.Parameters()).notes())
    assert ("hand" in notes) == bool(expected)


def test_the_root_has_its_own_inertia_where_it_may_move():
    robot = arm()
    built = build_model(robot, MujocoParameters(base="free"))
    base = built.model.body("base")
    assert base.mass == pytest.approx(1.0)
    np.testing.assert_allclose(base.inertia, 0.01)
    np.testing.assert_allclose(base.ipos, [0.0, 0.0, 0.1])
