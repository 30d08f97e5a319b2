"""The Pinocchio model: explicit joint order, the root's mass, frames, refusals."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from support.arm3 import URDF, describe, joint

from hoap3.protocol.errors import DescriptionError, FrameNotFoundError
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
HEAVY_BASE = URDF.replace(
    '<link name="base"/>',
    f"""<link name="base">
         <inertial><origin xyz="0.1 0 0"/><mass value="2"/>{INERTIA}</inertial>
       </link>
       <joint name="box_joint" type="fixed">
         <parent link="base"/><child link="box"/><origin xyz="0 0 1"/>
       </joint>
       <link name="box"><inertial><mass value="3"/>{INERTIA}</inertial></link>""",
)


def hand_position(model: RobotModel, q: np.ndarray) -> np.ndarray:
    q_pinocchio = np.empty(model.model.nq)
    q_pinocchio[model.order] = q
    pin.framesForwardKinematics(model.model, model.data, q_pinocchio)
    return model.data.oMf[model.frame_id("tool")].translation.copy()


def test_order_sends_the_wire_to_pinocchio_joint_by_joint():
    names = ("wrist", "shoulder", "elbow")
    arm = describe(joints=tuple(joint(name) for name in names), postures={"bent": (-0.5, 0.0, 1.0)})
    model = build_model(arm)
    assert model.order.tolist() == [2, 0, 1]
    assert [model.model.names[1 + int(index)] for index in model.order] == list(names)
    straight = build_model(describe())
    assert straight.order.tolist() == [0, 1, 2]
    q = np.array([0.3, 0.7, -0.4])  # shoulder, elbow, wrist
    np.testing.assert_array_equal(
        hand_position(model, q[[2, 0, 1]]), hand_position(straight, q), strict=True
    )


def test_every_joint_is_one_coordinate():
    prismatic = URDF.replace('"shoulder" type="revolute"', '"shoulder" type="prismatic"')
    model = build_model(describe(urdf=prismatic))
    assert model.model.nq == model.model.nv == 3
    assert hand_position(model, np.array([0.25, 0.0, 0.0]))[2] == pytest.approx(0.3 + 0.25)


def test_root_keeps_the_mass_of_all_that_is_fixed_to_it():
    model = build_model(describe(urdf=HEAVY_BASE))
    assert model.root_mass == 5.0
    np.testing.assert_allclose(model.root_com, [0.04, 0.0, 0.6], atol=1e-15)
    assert model.total_mass == pytest.approx(2.0 + 3.0 + 2.0 + 1.2 + 0.4, abs=1e-14)
    weightless = build_model(describe())
    assert weightless.root_mass == 0.0
    assert weightless.total_mass == pytest.approx(3.6, abs=1e-14)


def test_what_it_hands_out_is_read_only():
    model = build_model(describe())
    for array in (model.order, model.root_com):
        assert not array.flags.writeable


def test_frames_are_found_by_the_name_of_the_link_even_where_a_joint_has_it_too():
    twin = URDF.replace('name="tool_joint"', 'name="hand"')
    model = build_model(describe(urdf=twin))
    frame = model.model.frames[model.frame_id("hand")]
    assert frame.type == pin.FrameType.BODY
    assert frame.name == "hand"


def test_armature_and_friction_reach_pinocchio_in_its_order():
    """Armature as the description has it, in wire order; friction as the URDF has it."""
    rough = URDF.replace(
        'velocity="4.0" effort="4"/>',
        'velocity="4.0" effort="4"/><dynamics damping="0.3" friction="0.7"/>',
    )
    armature = {"wrist": 0.01, "shoulder": 0.2, "elbow": 0.05}
    arm = describe(
        urdf=rough,
        joints=tuple(joint(name, armature=value) for name, value in armature.items()),
        postures={"bent": (-0.5, 0.0, 1.0)},
    )
    assert arm.armature.tolist() == [0.01, 0.2, 0.05]
    model = build_model(arm)
    assert model.model.armature.tolist() == [0.2, 0.05, 0.01]
    assert model.model.damping.tolist() == [0.0, 0.0, 0.3]
    assert model.model.friction.tolist() == [0.0, 0.0, 0.7]
    bare = build_model(describe(urdf=rough))
    q, nothing = np.array([0.3, 0.7, -0.4]), np.zeros(3)
    with_it = pin.crba(model.model, model.data, q).diagonal()
    without = pin.crba(bare.model, bare.data, q).diagonal()
    np.testing.assert_allclose(with_it - without, [0.2, 0.05, 0.01], atol=1e-15)
    felt = pin.rnea(model.model, model.data, q, nothing, np.ones(3))
    unfelt = pin.rnea(bare.model, bare.data, q, nothing, np.ones(3))
    np.testing.assert_allclose(felt - unfelt, [0.2, 0.05, 0.01], atol=1e-14)


def test_unknown_frame_names_the_known_ones():
    with pytest.raises(FrameNotFoundError, match=r"'tol'.*'tool'") as caught:
        build_model(describe()).frame_id("tol")
    assert caught.value.known == sorted(["base", "upper_arm", "forearm", "hand", "tool"])


def test_what_pinocchio_refuses_is_a_description_error():
    broken = URDF.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><safety_controller/>')
    with pytest.raises(DescriptionError, match="'arm3'"):
        build_model(describe(urdf=broken))
